// itn materials: the media that `itn render --material` knows, and files for renderers of them and
// of other materials.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/exports/exports.h"
#include "client/exports/rgb_material.h"
#include "client/image/preview.h"
#include "client/json.h"
#include "client/measured_media.h"
#include "client/output.h"
#include "client/refine/refine_result.h"
#include "client/refine/refine_run.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/material.h"
#include "common/scene/material_proto.h"
#include "itn/v1/refine.pb.h"

namespace itn {
namespace {

struct MaterialsOptions {
  std::string name;
  std::vector<double> sigma_t, albedo, g;  // one each, or those of R, G and B
  std::vector<std::string> refined;  // folders of itn refine or fit: one, or those of R, G and B
  std::string format, output;
  std::optional<double> index, roughness;  // those of the material's own
  ExportOptions exports{.any_size = true};
};

// A material with what is known of its surface and its source.
struct NamedMaterial {
  std::string name{};
  std::vector<Material> channels{};  // gray, or R, G and B
  double index = 1, roughness = 0;
  std::string source{};
  std::vector<std::string> notes{};
};

NamedMaterial from_list(const MeasuredMedium& medium) {
  return {.name = std::string(medium.name),
          .channels = {medium.material(0), medium.material(1), medium.material(2)},
          .index = medium.index,
          .source = std::string(medium.source)};
}

NamedMaterial from_numbers(const MaterialsOptions& options) {
  NamedMaterial result{.name = "material", .source = "numbers of --sigma-t, --albedo and --g"};
  const std::vector<double> g = options.g.empty() ? std::vector{0.0} : options.g;
  const size_t count = std::max({options.sigma_t.size(), options.albedo.size(), g.size()});
  const auto channel = [&](const std::vector<double>& numbers, size_t c, const char* flag) {
    require_usage(numbers.size() == 1 || (numbers.size() == 3 && count == 3),
                  fmt::format("{} has {} numbers; 1, or 3 of R, G and B, would be right", flag,
                              numbers.size()));
    return numbers[numbers.size() == 1 ? 0 : c];
  };
  for (size_t c = 0; c < count; ++c) {
    result.channels.push_back({channel(options.sigma_t, c, "--sigma-t"),
                               channel(options.albedo, c, "--albedo"), channel(g, c, "--g")});
  }
  return result;
}

// What `itn refine -o` found, with its intervals, behind the boundary of the scene.
NamedMaterial from_refinement(std::vector<std::string> folders) {
  require_usage(folders.size() == 1 || folders.size() == 3,
                fmt::format("--refined has {} folders; 1, or 3 of R, G and B, would be right",
                            folders.size()));
  // One refinement of three colours has a folder for each.
  const std::filesystem::path first = folders[0];
  if (folders.size() == 1 && std::filesystem::exists(first / kRgb[0] / kRefineResultFile)) {
    folders.clear();
    for (const char* colour : kRgb) folders.push_back((first / colour).string());
  }
  NamedMaterial result{.name = "refined", .source = "a photograph, by itn"};
  std::vector<double> indices, roughnesses;
  for (const std::string& folder : folders) {
    const std::filesystem::path file = std::filesystem::path(folder) / kRefineResultFile;
    if (std::filesystem::exists(std::filesystem::path(folder) / kRefineStateFile) &&
        !std::filesystem::exists(file)) {
      throw invalid_input(fmt::format(
          "{} has a refinement that was stopped; the same command as before goes on with it",
          folder));
    }
    v1::RefineResult refined;
    from_json(read_file(file, "result"), file.string(), refined);
    if (refined.misfit()) {
      spdlog::warn("{} is a misfit: shape, light or exposure were not those of its scene", folder);
    }
    result.channels.push_back(from_proto(refined.material()));
    itn::validate(result.channels.back(), file.string());
    const auto interval = [](const char* name, const v1::RefinedParameter& of) {
      return fmt::format("{} {:.4g} ({:.4g} to {:.4g})", name, of.value(), of.low_95(),
                         of.high_95());
    };
    if (refined.unfinished()) {
      spdlog::warn("{} ended on its way: more iterations or time bring it nearer", folder);
    }
    result.notes.push_back(
        !has_intervals(refined)
            ? fmt::format("{}: a misfit, or unfinished; no interval is known", folder)
            : fmt::format(
                  "{}, 95 % intervals: {}, {}, {}, {}, {}", folder,
                  interval("sigma_s (1 - g)", refined.sigma_s_reduced()),
                  interval("sigma_a", refined.sigma_a()), interval("sigma_t", refined.sigma_t()),
                  interval("albedo", refined.albedo()),
                  is_as_given(refined.g()) ? fmt::format("g {:.4g} as given", refined.g().value())
                                           : interval("g", refined.g())));
    result.notes.insert(result.notes.end(), refined.remarks().begin(), refined.remarks().end());
    if (refined.has_index()) indices.push_back(refined.index());
    if (refined.has_roughness()) roughnesses.push_back(refined.roughness());
  }
  const auto mean = [](const std::vector<double>& of, double otherwise) {
    const double sum = std::accumulate(of.begin(), of.end(), 0.0);
    return of.empty() ? otherwise : sum / static_cast<double>(of.size());
  };
  result.index = mean(indices, 1);
  result.roughness = mean(roughnesses, 0);
  return result;
}

// What a thick piece returns of white light, as "#rrggbb".
std::string swatch(const NamedMaterial& of) {
  const RgbMaterial material = rgb_material(of.channels);
  std::string text = "#";
  for (size_t c = 0; c < 3; ++c) {
    text += fmt::format("{:02x}", to_srgb_byte(static_cast<float>(material.diffuse_albedo(c))));
  }
  return text;
}

void list(const std::vector<NamedMaterial>& materials) {
  const auto print_row = [](const auto&... columns) {
    print_result("{:<28} {:<8} {:<30} {:<26} {:<20} {:<6} {}\n", columns...);
  };
  print_row("name", "colour", "sigma_t in 1/mm: R, G, B", "albedo", "g", "index", "source");
  for (const NamedMaterial& material : materials) {
    const auto columns = [&](const char* format, double Material::*member) {
      std::string text;
      for (const Material& channel : material.channels) {
        text += fmt::format(fmt::runtime(format), channel.*member);
      }
      return text;
    };
    print_row(material.name, swatch(material), columns("{:<10.4g}", &Material::sigma_t),
              columns("{:.5f}  ", &Material::albedo), columns("{:.3f}  ", &Material::g),
              fmt::format("{:.4g}", material.index), material.source);
  }
}

void write(const NamedMaterial& material, MaterialsOptions options) {
  options.exports.name = material.name;
  options.exports.provenance = material.source;
  options.exports.notes = material.notes;
  const double index = options.index.value_or(material.index);
  require_usage(index != 1 || options.roughness.value_or(0) == 0,
                "--roughness is that of a surface, and there is none where the index is 1: give "
                "--index");
  if (index != 1)
    options.exports.boundary = {index, options.roughness.value_or(material.roughness)};
  const ExportFormat& format = export_format(options.format);
  require_own_suffix(format, options.output);
  const std::string text = format.write(rgb_material(material.channels), options.exports);
  if (options.output.empty()) {
    print_result(text);
  } else {
    write_file_atomically(options.output, text);
  }
}

// What the flags name; none: all of the list.
void run_materials(const MaterialsOptions& options) {
  std::vector<NamedMaterial> materials;
  if (!options.name.empty()) {
    materials.push_back(from_list(measured_medium(options.name)));
  } else if (!options.sigma_t.empty()) {
    materials.push_back(from_numbers(options));
  } else if (!options.refined.empty()) {
    materials.push_back(from_refinement(options.refined));
  } else {
    require_usage(options.format.empty(),
                  "--format needs a material: a name of the list, --sigma-t and --albedo, or "
                  "--refined");
    for (const MeasuredMedium& medium : measured_media()) materials.push_back(from_list(medium));
  }
  options.format.empty() ? list(materials) : write(materials[0], options);
}

}  // namespace

void add_materials_command(CLI::App& app) {
  const auto options = std::make_shared<MaterialsOptions>();
  CLI::App* command = app.add_subcommand(
      "materials",
      "List measured media, by the names that `itn render --material` takes. The colour is that of "
      "a thick piece under white light, without gloss. Jensen's sigma_s are reduced, so g is 0. "
      "With --format, write one for a renderer; or numbers of your own, or what itn refine found");
  CLI::Option* name =
      command->add_option("name", options->name, "Of one medium, to list or to write");
  std::vector<std::string> formats;
  for (const ExportFormat& format : export_formats()) formats.emplace_back(format.name);
  CLI::Option* format =
      command->add_option("--format", options->format, "Of the renderer (docs/exports.md)")
          ->check(CLI::IsMember(formats));
  const auto add_numbers = [&](const char* flag, std::vector<double>& numbers,
                               const char* description) {
    return command->add_option(flag, numbers, description)
        ->delimiter(',')
        ->allow_extra_args(false)
        ->excludes(name);
  };
  CLI::Option* sigma_t =
      add_numbers("--sigma-t", options->sigma_t,
                  "Extinction coefficient of a material of your own, in 1/mm; or three, of R, G "
                  "and B, separated by commas")
          ->check(number_in(kMinSigmaT, kMaxSigmaT));
  CLI::Option* albedo = add_numbers("--albedo", options->albedo, "Its albedo, or three")
                            ->check(number_in(0.0, 1.0))
                            ->needs(sigma_t);
  sigma_t->needs(albedo);
  add_numbers("--g", options->g, "Its mean cosine of scattering, or three")
      ->check(number_in(-kMaxAbsG, kMaxAbsG))
      ->default_str("0")
      ->needs(sigma_t);
  command
      ->add_option(
          "--refined", options->refined,
          "Folder of itn refine or itn fit --output; or three, of R, G and B, separated by "
          "commas")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->excludes(name)
      ->excludes(sigma_t);
  command->add_option("-o,--output", options->output, "File to write; default: standard output")
      ->needs(format);
  command
      ->add_option(
          "--index", options->index,
          "Index of refraction of the medium; default: what the list says or itn refine had, or "
          "1: light passes its surface as if there were none")
      ->check(number_in(1.0, 2.5))
      ->needs(format);
  command
      ->add_option(
          "--roughness", options->roughness,
          "Of its surface, alpha of GGX; 0: it is smooth; default: what itn refine had, or 0")
      ->check(number_in(0.0, 1.0))
      ->needs(format);
  add_scene_unit_flag(*command, options->exports.mm_per_scene_unit);
  command->callback([options] { run_materials(*options); });
}

}  // namespace itn
