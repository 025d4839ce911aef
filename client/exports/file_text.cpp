#include "client/exports/file_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "common/error.h"
#include "common/printable.h"

namespace itn {
namespace {

constexpr size_t kLongestProvenance = 400;

bool is_letter_or_digit(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
}

void check_length(const char* name, double millimetres) {
  if (!(millimetres > 0 && std::isfinite(millimetres))) {
    throw invalid_input(
        fmt::format("{} is {}; it must be a positive number of millimetres", name, millimetres));
  }
}

void check_boundary(const ExportBoundary& boundary) {
  const auto check = [](const char* name, double value, double low, double high) {
    if (value >= low && value <= high) return;
    throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", name, value, low, high));
  };
  check("boundary.index", boundary.index, 1, 2.5);
  check("boundary.roughness", boundary.roughness, 0, 1);
}

}  // namespace

std::string number(double value) {
  return fmt::format("{:.6g}", value);
}

std::string fraction(double value) {
  return fmt::format("{:.9g}", value);
}

std::string numbers(const std::array<double, 3>& v, std::string_view separator) {
  return number(v[0]).append(separator) + number(v[1]).append(separator) + number(v[2]);
}

std::string fractions(const std::array<double, 3>& v, std::string_view separator) {
  return fraction(v[0]).append(separator) + fraction(v[1]).append(separator) + fraction(v[2]);
}

std::string identifier(const ExportOptions& options) {
  std::string result;
  for (const char c : options.name) result += is_letter_or_digit(c) ? c : '_';
  // Node names of MaterialX and identifiers of XML must not begin with a digit.
  const bool begins_well = !result.empty() && !(result[0] >= '0' && result[0] <= '9');
  return begins_well ? result : "_" + result;
}

RgbMaterial of_object(const RgbMaterial& material, const ExportOptions& options) {
  const double size_mm = options.any_size ? 1 : options.object_size_mm.value_or(1);
  check_length("object_size_mm", size_mm);
  check_length("mm_per_scene_unit", options.mm_per_scene_unit);
  if (options.boundary) check_boundary(*options.boundary);
  return with_lengths_scaled(material, size_mm);
}

RgbMaterial in_scene_units(const RgbMaterial& material, const ExportOptions& options) {
  return with_lengths_scaled(of_object(material, options), 1 / options.mm_per_scene_unit);
}

std::vector<std::string> heading(const ExportOptions& options, std::string_view for_another_size) {
  std::vector<std::string> lines{fmt::format("{}: scattering material, {} by itn",
                                             identifier(options),
                                             options.any_size ? "written" : "estimated")};
  if (!options.provenance.empty()) {
    lines.push_back("from " + printable(options.provenance, kLongestProvenance));
  }
  for (const std::string& note : options.notes) {
    lines.push_back(printable(note, kLongestProvenance));
  }
  lines.push_back(fmt::format("1 scene unit = {} mm", number(options.mm_per_scene_unit)));
  if (options.boundary) {
    lines.push_back(fmt::format("index of refraction {}, roughness {} (alpha of GGX)",
                                number(options.boundary->index),
                                number(options.boundary->roughness)));
  }
  if (options.any_size) {
    lines.push_back("for objects of any size");
    return lines;
  }

  const double size_mm = options.object_size_mm.value_or(1);
  const std::string size = fmt::format("{} mm ({} scene units)", number(size_mm),
                                       number(size_mm / options.mm_per_scene_unit));
  if (options.object_size_mm) {
    lines.push_back("longest side of the object: " + size);
  } else {
    lines.push_back("The object's size is unknown: this holds for a longest side of " + size + ".");
    lines.push_back(fmt::format("If it is S mm, {}.", for_another_size));
  }
  return lines;
}

std::string coefficients(const RgbMaterial& of_object) {
  return fmt::format("sigma_a = {}; sigma_s = {} (R, G, B in 1/mm); g = {}",
                     numbers(of_object.sigma_a, " "), numbers(of_object.sigma_s, " "),
                     number(of_object.g));
}

std::string hash_comment(const std::vector<std::string>& lines) {
  std::string text;
  // Whatever they are made of, a line stays one.
  for (std::string line : lines) {
    std::ranges::replace_if(
        line, [](unsigned char c) { return std::iscntrl(c) != 0; }, ' ');
    text += line.empty() ? "#\n" : "# " + line + "\n";
  }
  return text;
}

std::string xml_comment(const std::vector<std::string>& lines) {
  std::string text = "<!--\n";
  for (const std::string& line : lines) {
    if (!line.empty()) text += "  ";
    // Two hyphens in a row must not occur in a comment (XML 1.0, section 2.5).
    for (const char c : line) text += c == '-' && text.back() == '-' ? " -" : std::string(1, c);
    text += "\n";
  }
  return text + "-->\n";
}

}  // namespace itn
