// itn materials: the media that `itn render --material` knows.
#include <fmt/format.h>

#include <array>
#include <string>

#include "client/commands/command.h"
#include "client/exports/rgb_material.h"
#include "client/output.h"
#include "common/image/preview.h"
#include "common/measured_media.h"

namespace itn {
namespace {

// What a thick piece returns of white light, as "#rrggbb".
std::string swatch(const MeasuredMedium& medium) {
  const std::array channels = {medium.material(0), medium.material(1), medium.material(2)};
  const RgbMaterial material = rgb_material(channels);
  std::string text = "#";
  for (size_t c = 0; c < 3; ++c) {
    text += fmt::format("{:02x}", to_srgb_byte(static_cast<float>(material.diffuse_albedo(c))));
  }
  return text;
}

void list() {
  const auto print_row = [](const auto&... columns) {
    print_result("{:<28} {:<8} {:<30} {:<26} {:<20} {:<6} {}\n", columns...);
  };
  print_row("name", "colour", "sigma_t in 1/mm: R, G, B", "albedo", "g", "index", "source");
  for (const MeasuredMedium& medium : measured_media()) {
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

}  // namespace

void add_materials_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "materials",
      "List measured media, by the names that `itn render --material` takes. The colour is that of "
      "a thick piece under white light, without gloss. Jensen's sigma_s are reduced, so g is 0");
  command->callback([] { list(); });
}

}  // namespace itn
