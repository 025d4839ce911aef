// OpenPBR Surface 1.1, https://academysoftwarefoundation.github.io/OpenPBR, in a document of
// MaterialX 1.39. The formulas are those that medium_colours.h cites.
#include <fmt/format.h>

#include <utility>

#include "client/exports/exports.h"
#include "client/exports/file_text.h"
#include "client/exports/medium_colours.h"

namespace itn {
namespace {

std::string input(std::string_view name, std::string_view type, std::string_view value,
                  std::string_view further_attributes = "") {
  return fmt::format("    <input name=\"{}\" type=\"{}\" value=\"{}\"{}/>\n", name, type, value,
                     further_attributes);
}

// The unit of a length, from which readers of MaterialX convert it to that of their scene. None for
// an object of unknown size: then the length is right for one of 1 unit.
std::string unit_attributes(const ExportOptions& options) {
  if (!options.any_size && !options.object_size_mm) return "";
  constexpr std::pair<double, std::string_view> kUnits[] = {
      {1, "millimeter"}, {10, "centimeter"}, {1000, "meter"}};
  for (const auto& [mm, unit] : kUnits) {
    if (mm != options.mm_per_scene_unit) continue;
    return fmt::format(" unittype=\"distance\" unit=\"{}\"", unit);
  }
  return "";
}

// Where it is index-matched, it is not glossy: with a specular_weight of 0 the index of refraction
// is that of the surroundings (section "Dielectric base"); specular_ior says the same to renderers
// that refract by it alone. specular_roughness is the root of alpha (section "Microfacet model").
std::string dielectric_base(const ExportOptions& options) {
  const auto& of = options.boundary;
  if (!of) return input("specular_weight", "float", "0") + input("specular_ior", "float", "1");
  return input("specular_weight", "float", "1") +
         input("specular_ior", "float", number(of->index)) +
         input("specular_roughness", "float", number(of->perceptual_roughness()));
}

std::string material_with(const std::string& name, const std::string& inputs) {
  return fmt::format(
      "  <open_pbr_surface name=\"{0}_shader\" type=\"surfaceshader\">\n"
      "{1}"
      "  </open_pbr_surface>\n"
      "  <surfacematerial name=\"{0}\" type=\"material\">\n"
      "    <input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"{0}_shader\"/>\n"
      "  </surfacematerial>\n",
      name, inputs);
}

std::string subsurface_inputs(const RgbMaterial& medium, const ExportOptions& options) {
  const SubsurfaceColours subsurface = subsurface_colours(medium);
  return dielectric_base(options) + input("subsurface_weight", "float", "1") +
         input("subsurface_color", "color3", fractions(subsurface.color, ", ")) +
         input("subsurface_radius", "float", number(subsurface.radius), unit_attributes(options)) +
         input("subsurface_radius_scale", "color3", fractions(subsurface.radius_scale, ", ")) +
         input("subsurface_scatter_anisotropy", "float", number(medium.g));
}

std::string transmission_inputs(const RgbMaterial& medium, const ExportOptions& options) {
  const TransmissionColours transmission = transmission_colours(medium);
  return dielectric_base(options) + input("transmission_weight", "float", "1") +
         input("transmission_color", "color3", fractions(transmission.color, ", ")) +
         input("transmission_depth", "float", number(transmission.depth),
               unit_attributes(options)) +
         input("transmission_scatter", "color3", fractions(transmission.scatter, ", ")) +
         input("transmission_scatter_anisotropy", "float", number(medium.g));
}

}  // namespace

std::string to_openpbr(const RgbMaterial& material, const ExportOptions& options) {
  const std::string name = identifier(options);
  const RgbMaterial medium = in_scene_units(material, options);
  std::vector<std::string> comment =
      heading(options, "multiply subsurface_radius and transmission_depth by S");
  comment.insert(
      comment.end(),
      {coefficients(of_object(material, options)), "",
       fmt::format("{}: by subsurface scattering, which all renderers have. Each inverts", name),
       "  subsurface_color to an albedo by a formula of its own; here it is van de Hulst's.",
       fmt::format("{}_volume: by transmission, which states the coefficients", name),
       "  themselves; for renderers that trace light through the medium."});
  return "<?xml version=\"1.0\"?>\n" + xml_comment(comment) + "<materialx version=\"1.39\">\n" +
         material_with(name, subsurface_inputs(medium, options)) +
         material_with(name + "_volume", transmission_inputs(medium, options)) + "</materialx>\n";
}

}  // namespace itn
