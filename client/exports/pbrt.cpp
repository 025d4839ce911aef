// pbrt-v4: https://pbrt.org/fileformat-v4, "Participating media", "Materials", and
// HomogeneousMedium::Create() in its src/pbrt/media.cpp: `scale` multiplies both coefficients, and
// the product is in the reciprocal of scene units.
#include <fmt/format.h>

#include "client/exports/exports.h"
#include "client/exports/file_text.h"

namespace itn {
namespace {

// `remaproughness` would take another measure of it than alpha.
std::string surface_material(const std::string& name,
                             const std::optional<ExportBoundary>& boundary) {
  if (!boundary) {
    return fmt::format("MakeNamedMaterial \"{}_boundary\" \"string type\" \"interface\"\n", name);
  }
  return fmt::format(
      "MakeNamedMaterial \"{}_boundary\"\n"
      "  \"string type\" \"dielectric\"\n"
      "  \"float eta\" {}\n"
      "  \"float roughness\" {}\n"
      "  \"bool remaproughness\" false\n",
      name, number(boundary->index), number(boundary->roughness));
}

}  // namespace

std::string to_pbrt(const RgbMaterial& material, const ExportOptions& options) {
  const std::string name = identifier(options);
  const RgbMaterial real = of_object(material, options);
  std::vector<std::string> comment = heading(options, "divide \"scale\" by S");
  comment.insert(
      comment.end(),
      {"", "In a scene, before WorldBegin or after:", "  Include \"...\"",
       "and around a closed shape:", "  AttributeBegin",
       fmt::format("    NamedMaterial \"{}_boundary\"", name),
       fmt::format("    MediumInterface \"{}\" \"\"", name), "    Shape ...", "  AttributeEnd",
       "Rendered by Integrator \"volpath\"; its maxdepth must allow for hundreds of",
       "scatterings."});
  return hash_comment(comment) + fmt::format(
                                     "\nMakeNamedMedium \"{}\"\n"
                                     "  \"string type\" \"homogeneous\"\n"
                                     "  \"rgb sigma_a\" [ {} ]  # in 1/mm\n"
                                     "  \"rgb sigma_s\" [ {} ]  # in 1/mm\n"
                                     "  \"float scale\" {}  # mm in a scene unit\n"
                                     "  \"float g\" {}\n"
                                     "{}",
                                     name, numbers(real.sigma_a, " "), numbers(real.sigma_s, " "),
                                     number(options.mm_per_scene_unit), number(material.g),
                                     surface_material(name, options.boundary));
}

}  // namespace itn
