// Arnold: https://help.autodesk.com/view/ARNOL, "Standard Surface: Transmission" and "Subsurface";
// the formulas are those that medium_colours.h cites.
#include <fmt/format.h>

#include "client/exports/exports.h"
#include "client/exports/file_text.h"
#include "client/exports/medium_colours.h"

namespace itn {
namespace {

// Arnold's roughness is the root of alpha.
std::string specular(const std::optional<ExportBoundary>& boundary) {
  if (!boundary) return " specular 0\n specular_IOR 1\n";
  return fmt::format(" specular 1\n specular_IOR {}\n specular_roughness {}\n",
                     number(boundary->index), number(boundary->perceptual_roughness()));
}

}  // namespace

std::string to_arnold(const RgbMaterial& material, const ExportOptions& options) {
  const std::string name = identifier(options);
  const RgbMaterial medium = in_scene_units(material, options);
  const TransmissionColours transmission = transmission_colours(medium);
  const SubsurfaceColours subsurface = subsurface_colours(medium);

  std::vector<std::string> comment =
      heading(options, "multiply transmission_depth and subsurface_scale by S");
  comment.insert(
      comment.end(),
      {coefficients(of_object(material, options)), "",
       fmt::format("A closed shape has it by: shader \"{}\", opaque off.", name),
       "GI_transmission_depth and GI_volume_depth of the options must allow for many scatterings.",
       "", "Cheaper and approximate, in place of the parameters on transmission:",
       " transmission 0", " subsurface 1", " subsurface_type \"randomwalk\"",
       fmt::format(" subsurface_color {}", fractions(subsurface.color, " ")),
       fmt::format(" subsurface_radius {}", fractions(subsurface.radius_scale, " ")),
       fmt::format(" subsurface_scale {}", number(subsurface.radius)),
       fmt::format(" subsurface_anisotropy {}", number(material.g))});
  return hash_comment(comment) + fmt::format(
                                     "\nstandard_surface\n"
                                     "{{\n"
                                     " name {}\n"
                                     " base 0\n"
                                     "{}"
                                     " transmission 1\n"
                                     " transmission_color {}\n"
                                     " transmission_depth {}\n"
                                     " transmission_scatter {}\n"
                                     " transmission_scatter_anisotropy {}\n"
                                     "}}\n",
                                     name, specular(options.boundary),
                                     fractions(transmission.color, " "), number(transmission.depth),
                                     fractions(transmission.scatter, " "), number(material.g));
}

}  // namespace itn
