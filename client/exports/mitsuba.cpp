// Mitsuba 3: https://mitsuba.readthedocs.io, "Homogeneous medium", "Henyey-Greenstein phase
// function", "Null material", "Smooth dielectric material", "Rough dielectric material".
#include <fmt/format.h>

#include <algorithm>

#include "client/exports/exports.h"
#include "client/exports/file_text.h"

namespace itn {
namespace {

// RGB values must be in [0, 1]; `scale` multiplies sigma_t and is in the reciprocal of scene units
// then ("Homogeneous medium", parameters).
std::string medium_parameters(const RgbMaterial& material, double mm_per_scene_unit) {
  if (material.gray) {
    return fmt::format(
        "    <float name=\"sigma_t\" value=\"{}\"/>  <!-- in 1/mm -->\n"
        "    <float name=\"scale\" value=\"{}\"/>  <!-- mm in a scene unit -->\n"
        "    <float name=\"albedo\" value=\"{}\"/>\n",
        number(material.sigma_t(0)), number(mm_per_scene_unit), fraction(material.albedo(0)));
  }
  const std::array<double, 3> sigma_t{material.sigma_t(0), material.sigma_t(1),
                                      material.sigma_t(2)};
  const double largest = *std::ranges::max_element(sigma_t);
  return fmt::format(
      "    <rgb name=\"sigma_t\" value=\"{}\"/>  <!-- over the largest -->\n"
      "    <float name=\"scale\" value=\"{}\"/>  <!-- the largest, in 1 / scene unit -->\n"
      "    <rgb name=\"albedo\" value=\"{}\"/>\n",
      fractions({sigma_t[0] / largest, sigma_t[1] / largest, sigma_t[2] / largest}, ", "),
      number(largest * mm_per_scene_unit),
      fractions({material.albedo(0), material.albedo(1), material.albedo(2)}, ", "));
}

std::string bsdf(const std::string& name, const std::optional<ExportBoundary>& boundary) {
  if (!boundary) return fmt::format("  <bsdf type=\"null\" id=\"{}_boundary\"/>\n", name);
  const std::string index = fmt::format(
      "    <float name=\"int_ior\" value=\"{}\"/>\n"
      "    <float name=\"ext_ior\" value=\"1\"/>\n",
      number(boundary->index));
  const std::string roughness = fmt::format(
      "    <string name=\"distribution\" value=\"ggx\"/>\n"
      "    <float name=\"alpha\" value=\"{}\"/>\n",
      number(boundary->roughness));
  const bool rough = boundary->roughness > 0;
  return fmt::format("  <bsdf type=\"{}\" id=\"{}_boundary\">\n{}{}  </bsdf>\n",
                     rough ? "roughdielectric" : "dielectric", name, index, rough ? roughness : "");
}

}  // namespace

std::string to_mitsuba(const RgbMaterial& material, const ExportOptions& options) {
  const std::string name = identifier(options);
  const RgbMaterial real = of_object(material, options);
  std::vector<std::string> comment = heading(options, "divide 'scale' by S");
  comment.insert(
      comment.end(),
      {"", "In a scene, with the path of this file:", "  <include filename=\"...\"/>",
       "and in a closed shape:",
       fmt::format("  <ref id=\"{0}_boundary\"/> <ref name=\"interior\" id=\"{0}\"/>", name),
       "Rendered by an integrator for volumes: volpath, or volpathmis for colours; max_depth must",
       "allow for hundreds of scatterings."});
  return "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n" + xml_comment(comment) +
         fmt::format(
             "<scene version=\"3.0.0\">\n"
             "{3}"
             "  <medium type=\"homogeneous\" id=\"{0}\">\n"
             "{1}"
             "    <phase type=\"hg\">\n"
             "      <float name=\"g\" value=\"{2}\"/>\n"
             "    </phase>\n"
             "  </medium>\n"
             "</scene>\n",
             name, medium_parameters(real, options.mm_per_scene_unit), number(material.g),
             bsdf(name, options.boundary));
}

}  // namespace itn
