// Materials as files of renderers. docs/exports.md has the formulas, and how each file is used.
#pragma once

#include <cmath>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "client/exports/rgb_material.h"

namespace itn {

// What bounds the object: a dielectric, whose microfacets are of the distribution GGX.
struct ExportBoundary {
  double index = 1.5;    // of refraction, relative to what is around it; in [1, 2.5]
  double roughness = 0;  // alpha, in [0, 1]; 0: smooth

  // What programs ask for that square it.
  double perceptual_roughness() const { return std::sqrt(roughness); }
};

struct ExportOptions {
  // The name of the material in the scene; what is no ASCII letter or digit becomes an underscore.
  std::string name = "material";
  // Length of the renderer's scene unit: 1 where the scene is in mm, 10 in cm, 1000 in m.
  double mm_per_scene_unit = 1;
  // Longest side of the object. Materials are predicted in 1/mm for an object whose longest side is
  // 1 mm, and are divided by this. Absent: unknown; then the file is for an object of 1 mm, and
  // says so, and what to change for another.
  std::optional<double> object_size_mm{};
  // Says in the file's comment where the material comes from (model, image). May be empty.
  std::string provenance{};
  // Further lines of that comment, as intervals and what limits the answer.
  std::vector<std::string> notes{};
  // The material is in 1/mm whatever it fills: `object_size_mm` is not looked at.
  bool any_size = false;
  std::optional<ExportBoundary> boundary{};  // absent: index-matched
};

struct ExportFormat {
  std::string_view name;
  std::string_view extension;    // of its files, with the dot
  std::string_view description;  // one line
  std::string (*write)(const RgbMaterial&, const ExportOptions&);
};

// All there are.
std::span<const ExportFormat> export_formats();

// Throws Error (usage) that lists the names there are.
const ExportFormat& export_format(std::string_view name);

// Throws Error (usage) where the file is named as those of another format are.
void require_own_suffix(const ExportFormat& format, const std::filesystem::path& file);

// The text of the file. `material` is that of an object whose longest side is 1 mm, in 1/mm.
// Numbers have 6 significant digits; those between 0 and 1 that mean what they lack of 1 (albedos,
// colours) have 9, as many as tell single-precision numbers apart. Throws Error (invalid input) if
// a length in the options is not positive, or the boundary is out of range.
std::string to_mitsuba(const RgbMaterial& material, const ExportOptions& options);
std::string to_pbrt(const RgbMaterial& material, const ExportOptions& options);
std::string to_blender(const RgbMaterial& material, const ExportOptions& options);
std::string to_arnold(const RgbMaterial& material, const ExportOptions& options);
std::string to_openpbr(const RgbMaterial& material, const ExportOptions& options);

}  // namespace itn
