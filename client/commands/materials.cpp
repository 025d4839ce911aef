// itn materials: the media that `itn render --material` knows, and their files for renderers.
#include <fmt/format.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/exports/exports.h"
#include "client/exports/rgb_material.h"
#include "client/output.h"
#include "common/files/atomic_file.h"
#include "common/image/preview.h"
#include "common/measured_media.h"

namespace itn {
namespace {

struct MaterialsOptions {
  std::string name, format, output;
  std::optional<double> index;  // that of the list
  double roughness = 0;
  ExportOptions exports{.any_size = true};
};

RgbMaterial rgb_of(const MeasuredMedium& medium) {
  return rgb_material(std::array{medium.material(0), medium.material(1), medium.material(2)});
}

// What a thick piece returns of white light, as "#rrggbb".
std::string swatch(const MeasuredMedium& medium) {
  const RgbMaterial material = rgb_of(medium);
  std::string text = "#";
  for (size_t c = 0; c < 3; ++c) {
    text += fmt::format("{:02x}", to_srgb_byte(static_cast<float>(material.diffuse_albedo(c))));
  }
  return text;
}

// All, or the one of this name.
void list(const std::string& name) {
  if (!name.empty()) measured_medium(name);  // is known
  const auto print_row = [](const auto&... columns) {
    print_result("{:<28} {:<8} {:<30} {:<26} {:<20} {:<6} {}\n", columns...);
  };
  print_row("name", "colour", "sigma_t in 1/mm: R, G, B", "albedo", "g", "index", "source");
  for (const MeasuredMedium& medium : measured_media()) {
    if (!name.empty() && medium.name != name) continue;
    const auto columns = [&](const char* format, double Material::*member) {
      std::string text;
      for (size_t c = 0; c < 3; ++c) {
        text += fmt::format(fmt::runtime(format), medium.material(c).*member);
      }
      return text;
    };
    print_row(medium.name, swatch(medium), columns("{:<10.4g}", &Material::sigma_t),
              columns("{:.5f}  ", &Material::albedo), columns("{:.3f}  ", &Material::g),
              medium.index, medium.source);
  }
}

void write(MaterialsOptions options) {
  const MeasuredMedium& medium = measured_medium(options.name);
  options.exports.name = medium.name;
  options.exports.provenance = medium.source;
  const double index = options.index.value_or(medium.index);
  if (index != 1) options.exports.boundary = {index, options.roughness};
  const std::string text = export_format(options.format).write(rgb_of(medium), options.exports);
  if (options.output.empty()) {
    print_result(text);
  } else {
    write_file_atomically(options.output, text);
  }
}

}  // namespace

void add_materials_command(CLI::App& app) {
  const auto options = std::make_shared<MaterialsOptions>();
  CLI::App* command = app.add_subcommand(
      "materials",
      "List measured media, by the names that `itn render --material` takes. The colour is that of "
      "a thick piece under white light, without gloss. Jensen's sigma_s are reduced, so g is 0. "
      "With --format, write one for a renderer");
  CLI::Option* name =
      command->add_option("name", options->name, "Of one medium, to list or to write");
  std::vector<std::string> formats;
  for (const ExportFormat& format : export_formats()) formats.emplace_back(format.name);
  CLI::Option* format =
      command->add_option("--format", options->format, "Of the renderer (docs/exports.md)")
          ->check(CLI::IsMember(formats))
          ->needs(name);
  command->add_option("-o,--output", options->output, "File to write; default: standard output")
      ->needs(format);
  command
      ->add_option(
          "--index", options->index,
          "Index of refraction of the medium; default: what the list says; 1: light passes "
          "its surface as if there were none")
      ->check(number_in(1.0, 2.5))
      ->needs(format);
  command
      ->add_option("--roughness", options->roughness,
                   "Of its surface, alpha of GGX; 0: it is smooth")
      ->check(number_in(0.0, 1.0))
      ->capture_default_str()
      ->needs(format);
  add_scene_unit_flag(*command, options->exports.mm_per_scene_unit);
  command->callback([options] { options->format.empty() ? list(options->name) : write(*options); });
}

}  // namespace itn
