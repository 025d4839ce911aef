// itn import: scenes of other programs as ours.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/exports/file_text.h"
#include "client/import/import_mitsuba.h"
#include "client/object_media.h"
#include "client/output.h"
#include "client/scene/scene_file.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/printable.h"
#include "server/renderer.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

struct ImportFlags {
  std::string input, output;
  ImportOptions options;
};

// What renders it: the medium in the film's channel, or in colour.
std::string command_of(const ImportedScene& imported, const fs::path& output) {
  std::string text = fmt::format("itn render {} -o {}", output.string(),
                                 fs::path(output).replace_extension("exr").string());
  const v1::Film::Channel channel = imported.scene.film().channel();
  bool by_numbers = false;
  if (imported.medium) {
    const std::array<Material, 3>& medium = *imported.medium;
    const auto flag = [&](const char* name, double Material::*member) {
      const double r = medium[0].*member, g = medium[1].*member, b = medium[2].*member;
      if (channel != v1::Film::LUMINANCE) {
        const double one = medium[static_cast<size_t>(channel - v1::Film::RED)].*member;
        text += fmt::format(" --{} {:.6g}", name, one);
      } else if (r == g && g == b) {
        text += fmt::format(" --{} {:.6g}", name, r);
      } else {
        text += fmt::format(" --{} {:.6g},{:.6g},{:.6g}", name, r, g, b);
        by_numbers = true;
      }
    };
    flag("sigma-t", &Material::sigma_t);
    flag("albedo", &Material::albedo);
    if (imported.phase.empty()) flag("g", &Material::g);
  }
  if (imported.in_colour && !by_numbers) text += " --color";
  if (!imported.phase.empty()) text += fmt::format(" --phase '{}'", imported.phase);
  if (imported.samples > 0) text += fmt::format(" --spp {}", imported.samples);
  return text;
}

// What of the scene cannot be rendered, as numbers beyond their ranges: an error. What is to be
// added to it is told: files that are not there yet, and what the scene that was imported does not
// have.
void check_imported(const fs::path& file, const ImportedScene& imported) {
  const bool whole = imported.scene.has_object() && !imported.scene.lights().empty();
  try {
    v1::Scene scene = load_scene(file);
    resolve_media(scene);
    if (whole) check_scene(scene);
  } catch (const Error& error) {
    if (whole && error.kind() == ErrorKind::kInvalidInput) {
      throw Error(error.kind(), fmt::format("{} is written, but cannot be rendered: {}",
                                            file.string(), error.what()));
    }
    spdlog::warn("it cannot be rendered yet: {}", error.what());
  }
}

// NAME=VALUE, for `definitions`.
void define(const std::string& text, std::map<std::string, std::string>& definitions) {
  const size_t equals = text.find('=');
  require_usage(equals != std::string::npos && equals > 0,
                fmt::format("-D {}: it is NAME=VALUE", printable(text)));
  const bool is_new = definitions.emplace(text.substr(0, equals), text.substr(equals + 1)).second;
  require_usage(is_new, fmt::format("-D {}: it is defined twice", printable(text)));
}

void run_import(ImportFlags flags) {
  require_usage(!is_stdout(flags.output),
                "--output -: the scene file refers to others by where it is; name a file");
  check_writable(flags.output);
  require_no_input("--output", flags.output, {flags.input});
  flags.options.output_folder = fs::path(flags.output).parent_path();
  const ImportedScene imported = import_mitsuba(flags.input, flags.options);
  const std::string command = command_of(imported, flags.output);
  std::string notes;
  std::vector<std::string> comment{
      fmt::format("From {}.", fs::path(flags.input).filename().string()), command};
  if (!imported.not_carried_over.empty()) comment.emplace_back("Not carried over:");
  for (const std::string& note : imported.not_carried_over) {
    comment.push_back("  " + note);
    notes += comment.back() + '\n';
  }
  write_file_atomically(flags.output, hash_comment(comment) + to_text_proto(imported.scene));

  const v1::Scene& scene = imported.scene;
  const int objects = (scene.has_object() ? 1 : 0) + scene.other_objects_size();
  print_result("{}: {} x {} pixels, objects {}, surfaces {}, lights {}\n", flags.output,
               scene.film().width(), scene.film().height(), objects, scene.surfaces_size(),
               scene.lights_size());
  if (!notes.empty()) print_result("not carried over:\n{}", notes);
  check_imported(flags.output, imported);
  print_result("render it: {}\n", command);
}

}  // namespace

void add_import_command(CLI::App& app) {
  const auto flags = std::make_shared<ImportFlags>();
  CLI::App* command = app.add_subcommand(
      "import",
      "Make a scene file from a scene of Mitsuba 0.6 or 3. Prints what renders it, with the medium "
      "of the file, and what has no counterpart here");
  command->add_option("scene", flags->input, "XML file of Mitsuba")->required();
  command->add_option("-o,--output", flags->output, "Scene file to write")->required();
  add_scene_unit_flag(*command, flags->options.mm_per_scene_unit);
  command
      ->add_option_function<std::vector<std::string>>(
          "-D,--define",
          [flags](const std::vector<std::string>& texts) {
            for (const std::string& text : texts) define(text, flags->options.definitions);
          },
          "NAME=VALUE: what $NAME stands for in the file, instead of its default. May be repeated")
      ->allow_extra_args(false);
  command
      ->add_option_function<std::string>(
          "--channel",
          [flags](std::string name) {
            std::ranges::transform(name, name.begin(),
                                   [](unsigned char c) { return std::toupper(c); });
            v1::Film::Channel_Parse(name, &flags->options.channel);
          },
          "What of colours is taken: luminance (colours of surfaces and lights stay), red, green "
          "or blue")
      ->check(CLI::IsMember({"luminance", "red", "green", "blue"}))
      ->default_str("luminance");
  command->callback([flags] { run_import(*flags); });
}

}  // namespace itn
