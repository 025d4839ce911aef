// What the files of all formats have in common.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "client/exports/exports.h"
#include "client/exports/rgb_material.h"

namespace itn {

// With 6 significant digits, whatever the locale.
std::string number(double value);

// With 9: for numbers that are near to 1, where their difference to 1 is what counts.
std::string fraction(double value);

// Writes R, G and B with `separator` between them.
std::string numbers(const std::array<double, 3>& values, std::string_view separator);
std::string fractions(const std::array<double, 3>& values, std::string_view separator);

// The options' name as an identifier that every format takes.
std::string identifier(const ExportOptions& options);

// The material of the object in its real size, in 1/mm. Throws as to_mitsuba() does.
RgbMaterial of_object(const RgbMaterial& material, const ExportOptions& options);

// The material in the reciprocal of scene units.
RgbMaterial in_scene_units(const RgbMaterial& material, const ExportOptions& options);

// Lines of ASCII for the comment at the top: what this is, where from, in which units, behind which
// boundary, of which size. `for_another_size` says what to do if the longest side is S mm.
std::vector<std::string> heading(const ExportOptions& options, std::string_view for_another_size);

// A line with the coefficients, for formats that have them in another form.
std::string coefficients(const RgbMaterial& of_object);

// Lines as a comment: each after "# ", or all of them in a comment of XML.
std::string hash_comment(const std::vector<std::string>& lines);
std::string xml_comment(const std::vector<std::string>& lines);

}  // namespace itn
