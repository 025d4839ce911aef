// itn dataset: renders images of shapes under skies, with known materials.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/config_flags.h"
#include "client/commands/options.h"
#include "client/dataset/dataset_config.h"
#include "client/dataset/dataset_render.h"
#include "client/dataset/distribution.h"
#include "client/dataset/panorama_set.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/presets/presets.h"
#include "client/progress.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/material.h"

namespace itn {
namespace {

using Config = v1::DatasetConfig;

struct DatasetOptions {
  explicit DatasetOptions(CLI::App& command) : changes(command) {}

  std::string folder;
  std::string config, preset;
  ConfigFlags<v1::DatasetConfig> changes;  // of what file, preset or dataset say
  bool print_config = false;
  WorkerFlags workers;
  bool json = false;
};

v1::Distribution list_of(const std::vector<double>& values) {
  v1::Distribution result;
  result.mutable_one_of()->mutable_value()->Assign(values.begin(), values.end());
  return result;
}

// "5%" or "0.05".
double noise_of(const std::string& text) {
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  const std::string_view unit(rest, end);
  if (error != std::errc() || !(unit.empty() || unit == "%")) {
    throw Error(ErrorKind::kUsage,
                fmt::format("--noise is \"{}\"; it is a part like 5% or 0.05", text));
  }
  return unit.empty() ? value : value / 100;
}

// The suns of a configuration; flags of azimuths are about them.
std::vector<v1::SunSkyChoice*> suns_of(v1::DatasetConfig& config, const char* flag) {
  std::vector<v1::SunSkyChoice*> suns;
  for (v1::LightChoice& light : *config.mutable_lights()) {
    if (light.has_sun_sky()) suns.push_back(light.mutable_sun_sky());
  }
  if (suns.empty()) {
    throw Error(ErrorKind::kUsage, fmt::format("{} is given, and no light is a sun", flag));
  }
  return suns;
}

// The panoramas of a configuration, which are one more of its lights unless they are there.
v1::PanoramaChoice& panoramas_in(v1::DatasetConfig& config) {
  for (v1::LightChoice& light : *config.mutable_lights()) {
    if (light.has_panoramas()) return *light.mutable_panoramas();
  }
  return *config.add_lights()->mutable_panoramas();
}

// The materials of Che et al. 2020, whose number follows.
void set_grid(v1::DatasetConfig& config) {
  v1::MaterialChoice& materials = *config.mutable_materials();
  materials.set_sampling(v1::MaterialChoice::GRID);
  *materials.mutable_sigma_t() = list_of({30, 36, 44, 54, 67, 82, 100, 122, 150, 184, 225, 276});
  *materials.mutable_albedo() = list_of({0.39, 0.59, 0.74, 0.87, 0.95});
  *materials.mutable_g() = list_of({0, 0.2, 0.4, 0.6, 0.8});
  config.set_count(0);
}

// What the flags say, over the file or the preset; of a dataset that is continued without one of
// these, over what it has.
v1::DatasetConfig config_of(const DatasetOptions& options,
                            const std::optional<v1::Dataset>& existing) {
  const bool is_new = !options.config.empty() || !options.preset.empty() || !existing;
  v1::DatasetConfig config = !options.config.empty()   ? load_dataset_config(options.config)
                             : !options.preset.empty() ? preset_config(options.preset)
                             : existing                ? existing->config()
                                                       : preset_config("paper");
  options.changes.apply_to(config);
  set_defaults(config);
  if (is_new) validate(config);
  return config;
}

// The dataset that the folder holds, if it holds one.
std::optional<v1::Dataset> manifest_in(const std::string& folder) {
  const std::filesystem::path path = std::filesystem::path(folder) / kManifestName;
  return std::filesystem::exists(path) ? std::optional(read_manifest(path)) : std::nullopt;
}

// The shapes and panoramas of a dataset that is there are those that it holds, where nothing says
// otherwise; render_dataset() says what differs.
DatasetPlan plan_of(const DatasetOptions& options, v1::DatasetSummary& summary) {
  const std::optional<v1::Dataset> existing = manifest_in(options.folder);
  const v1::DatasetConfig config = config_of(options, existing);
  const bool names_shapes =
      config.shapes().has_folder() && !config.shapes().folder().path().empty();
  const v1::PanoramaChoice* choice = panoramas_of(config);
  const bool names_panoramas = choice != nullptr && !choice->folder().empty();
  if (existing && !names_shapes && !names_panoramas) {
    require_same_config(*existing, config, options.folder);
    return config.count() == existing->config().count() ? DatasetPlan{*existing, {}}
                                                        : extended(*existing, config.count());
  }
  const ShapeSet shapes =
      existing && !names_shapes ? shape_set(*existing) : shape_set(config.shapes());
  const PanoramaSet panoramas =
      existing && !names_panoramas ? panorama_set(*existing) : panorama_set(config);
  const auto refuse = [](const std::vector<std::string>& messages, auto* refused) {
    for (const std::string& message : messages) spdlog::warn("not used: {}", message);
    refused->Assign(messages.begin(), messages.end());
  };
  refuse(shapes.refused, summary.mutable_refused_shapes());
  for (const std::string& message : shapes.alike) spdlog::warn("{}", message);
  refuse(panoramas.refused, summary.mutable_refused_panoramas());
  return plan_dataset(config, shapes.shapes, panoramas.panoramas);
}

DatasetProgress render(const DatasetOptions& options, DatasetPlan plan, JobRenderer& pool) {
  std::optional<Progress> progress;
  const DatasetProgress result = render_dataset(
      std::move(plan), options.folder, pool,
      [&](const DatasetProgress& now) {
        if (!progress) progress.emplace("dataset", "images", now.total, now.done);
        progress->update(now.done);
      },
      interruption());
  progress->finish();
  return result;
}

void describe(const v1::Dataset& manifest, v1::DatasetSummary& summary) {
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    switch (shape.split()) {
      case v1::SPLIT_TEST: summary.add_test_shapes(shape.name()); break;
      case v1::SPLIT_VALIDATION: summary.add_validation_shapes(shape.name()); break;
      default: summary.add_train_shapes(shape.name());
    }
  }
  const auto images_of = [&](v1::Split split) {
    return static_cast<uint32_t>(
        std::ranges::count(manifest.items(), split, &v1::DatasetItem::split));
  };
  summary.set_train_images(images_of(v1::SPLIT_TRAIN));
  summary.set_validation_images(images_of(v1::SPLIT_VALIDATION));
  summary.set_test_images(images_of(v1::SPLIT_TEST));
}

// Names as long as they can be read at a glance.
std::string names_of(const google::protobuf::RepeatedPtrField<std::string>& shapes) {
  constexpr int kMaxNames = 20;
  return shapes.size() <= kMaxNames ? fmt::format("{}", fmt::join(shapes, ", "))
                                    : fmt::format("{} shapes", shapes.size());
}

void print(const v1::DatasetSummary& summary) {
  const std::string validation =
      summary.validation_shapes().empty()
          ? ""
          : fmt::format("{} validation images of {}; ", summary.validation_images(),
                        names_of(summary.validation_shapes()));
  print_result("{}: {} training images of {}; {}{} test images of {}\n", summary.folder(),
               summary.train_images(), names_of(summary.train_shapes()), validation,
               summary.test_images(), names_of(summary.test_shapes()));
}

bool changes_preset(const CLI::App& command) {
  return std::ranges::any_of(command.get_options(), [](const CLI::Option* option) {
    return option->count() > 0 && option->get_name() != "--preset" &&
           option->get_name() != "--print-config";
  });
}

// A preset as it is, with its comments; else what the flags make of it or of the file.
void print_config(const DatasetOptions& options, const CLI::App& command) {
  if (!changes_preset(command)) {
    const std::string name = options.preset.empty() ? "paper" : options.preset;
    print_result("{}", find_preset(dataset_presets(), name).file);
  } else {
    print_result("{}", to_text_proto(config_of(options, std::nullopt)));
  }
}

void run(const DatasetOptions& options, const CLI::App& command) {
  if (options.print_config) return print_config(options, command);
  if (options.folder.empty()) throw Error(ErrorKind::kUsage, "which folder? itn dataset FOLDER");
  const auto start = std::chrono::steady_clock::now();
  check_folder_writable(options.folder);
  v1::DatasetSummary summary;
  summary.set_folder(options.folder);
  DatasetPlan plan = plan_of(options, summary);
  describe(plan.manifest, summary);
  RenderPool pool(options.workers.pool_options());
  const DatasetProgress rendered = render(options, std::move(plan), pool);
  summary.set_kept(static_cast<uint32_t>(rendered.kept));
  summary.set_dropped_fraction(rendered.paths == 0 ? 0
                                                   : static_cast<double>(rendered.dropped) /
                                                         static_cast<double>(rendered.paths));
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  summary.set_seconds(elapsed.count());
  summary.set_render_cpu_seconds(pool.statistics().cpu_seconds);
  options.json ? print_result("{}\n", to_json(summary)) : print(summary);
}

void add_shape_flags(ConfigFlags<Config>& changes) {
  CLI::Option* folder = changes.add<std::string>(
      "--shapes",
      [](Config& config, const std::string& path) {
        if (path.empty()) return;
        config.mutable_shapes()->mutable_folder()->set_path(path);
        config.mutable_shapes()->mutable_folder()->set_repair(false);
      },
      "Folder of closed PLY, OBJ or STL meshes; without: the built-in shapes");
  CLI::Option* random = changes
                            .add<uint32_t>(
                                "--random-shapes",
                                [](Config& config, uint32_t count) {
                                  config.mutable_shapes()->mutable_random()->set_count(count);
                                },
                                "Instead: this many of an endless family of random shapes")
                            ->excludes(folder);
  changes
      .add<uint64_t>(
          "--shape-seed",
          [](Config& config, uint64_t seed) {
            config.mutable_shapes()->mutable_random()->set_seed(seed);
          },
          "Of random shapes: another one gives others. --seed does not: datasets of two "
          "seeds share the shapes that they both have, and a test of shapes that training "
          "has not seen needs another --shape-seed")
      ->check(kAnySeed)
      ->needs(random)
      ->default_str("0");
  changes.add<std::string>(
      "--panoramas",
      [](Config& config, const std::string& path) {
        if (!path.empty()) panoramas_in(config).set_folder(path);
      },
      "Folder of HDR panoramas (EXR, latitude-longitude): one more of the lights, "
      "of weight 1, unless the dataset file has them");
  changes.add_switch(
      "--repair",
      [](Config& config, bool repair) {
        if (config.shapes().has_folder()) {
          config.mutable_shapes()->mutable_folder()->set_repair(repair);
        }
      },
      "Close meshes of --shapes that are nearly closed: weld cracks, fill holes, turn "
      "triangles; says what it changed");
  changes
      .add<std::vector<std::string>>(
          "--test-shapes",
          [](Config& config, const std::vector<std::string>& names) {
            config.mutable_test_shapes()->Assign(names.begin(), names.end());
          },
          "Names of the shapes to test with, separated by commas; without: a random choice")
      ->delimiter(',');
  changes
      .add<std::vector<std::string>>(
          "--validation-shapes",
          [](Config& config, const std::vector<std::string>& names) {
            config.mutable_validation_shapes()->Assign(names.begin(), names.end());
          },
          "Likewise for validation")
      ->delimiter(',');
}

void add_image_flags(ConfigFlags<Config>& changes) {
  CLI::Option* count = changes
                           .add<uint32_t>("--count", &Config::set_count,
                                          "Images, of all splits together; default 400, or as the "
                                          "preset says. A dataset that is there "
                                          "may be given more")
                           ->check(number_in(2U, UINT32_MAX));
  CLI::Option* grid = changes
                          .add_switch(
                              "--grid",
                              [](Config& config, bool is_grid) {
                                if (is_grid) set_grid(config);
                              },
                              "All 300 materials of Che et al. 2020 for every shape and azimuth")
                          ->excludes(count);
  changes
      .add_switch(
          "--random",
          [](Config& config, bool random) {
            if (random) config.mutable_materials()->set_sampling(v1::MaterialChoice::RANDOM);
          },
          "Independent materials rather than evenly spread ones")
      ->excludes(grid);
  changes.add_switch(
      "--rotate",
      [](Config& config, bool rotate) {
        if (!rotate) return;
        config.mutable_pose()->Clear();
        config.mutable_pose()->set_turned(1);
      },
      "Turn each object about +y by a random angle");
  changes.add<uint32_t>("--resolution", &Config::set_resolution, "Pixels a side; default 128")
      ->check(one_of({"16", "32", "64", "128", "256"}));
  CLI::Option* spp = changes
                         .add<uint32_t>(
                             "--spp",
                             [](Config& config, uint32_t samples) {
                               config.set_spp(samples);
                               config.clear_noise();
                             },
                             "Samples per pixel; default 256")
                         ->check(kSppRange);
  changes
      .add<std::string>(
          "--noise",
          [](Config& config, const std::string& noise) {
            config.mutable_noise()->set_target(noise_of(noise));
            config.clear_spp();
          },
          "Instead: as many samples for each image as bring its relative noise to this, "
          "e.g. 5%")
      ->excludes(spp);
  changes.add<uint32_t>("--views", &Config::set_views,
                        "Images of each object, one after the other, for itn evaluate "
                        "--one-material: of one shape, material and surface; default 1");
  changes.add_switch("--derivatives", &Config::set_derivatives,
                     "Derivative images, too, in sigma_t, albedo and g, for itn train "
                     "--first-order-step: 1.2 times the time, five times the room");
  changes
      .add<uint64_t>("--seed", &Config::set_seed,
                     "Of all choices but the random shapes (--shape-seed); default 0")
      ->check(kAnySeed);
  changes
      .add<double>("--test-fraction", &Config::set_test_fraction,
                   "Of shapes and images; default 0.25")
      ->check(number_in(0.0, 1.0, Ends::kExcluded));
  changes
      .add<double>("--validation-fraction", &Config::set_validation_fraction,
                   "Likewise, 0 for none; default 0.1")
      ->check(number_in(0.0, 0.99));
  changes
      .add<std::vector<double>>(
          "--train-azimuths",
          [](Config& config, const std::vector<double>& azimuths) {
            for (v1::SunSkyChoice* sun : suns_of(config, "--train-azimuths")) {
              *sun->mutable_azimuth_degrees() = list_of(azimuths);
            }
          },
          "Of the sun, in degrees, separated by commas; default 0,30,60,90")
      ->check(number_in(-360.0, 360.0))
      ->delimiter(',');
  changes
      .add<std::vector<double>>(
          "--test-azimuths",
          [](Config& config, const std::vector<double>& azimuths) {
            for (v1::SunSkyChoice* sun : suns_of(config, "--test-azimuths")) {
              *sun->mutable_test_azimuth_degrees() = list_of(azimuths);
            }
          },
          "Likewise; default 10,20,40,50,70,80")
      ->check(number_in(-360.0, 360.0))
      ->delimiter(',');
  using Range = std::pair<double, double>;
  const auto add_range = [&](const char* flag, auto change, const std::string& description,
                             const CLI::Validator& limits) {
    const auto of_materials = [change](Config& config, const Range& range) {
      change(*config.mutable_materials(), range);
    };
    changes.add<Range>(flag, of_materials, description)
        ->type_name("MIN MAX")
        ->check(limits)
        ->excludes(grid);
  };
  add_range(
      "--sigma-t",
      [](v1::MaterialChoice& materials, const Range& range) {
        *materials.mutable_sigma_t() = log_uniform(range.first, range.second);
      },
      "Of the materials, in 1/mm, log-uniform; default 30 276", number_in(kMinSigmaT, kMaxSigmaT));
  add_range(
      "--albedo",
      [](v1::MaterialChoice& materials, const Range& range) {
        *materials.mutable_albedo() = uniform(range.first, range.second);
      },
      "Of the materials, uniform; default 0.39 0.95", number_in(0.0, 1.0));
  add_range(
      "--g",
      [](v1::MaterialChoice& materials, const Range& range) {
        *materials.mutable_g() = uniform(range.first, range.second);
      },
      "Of the materials, uniform; default 0 0.8", number_in(-kMaxAbsG, kMaxAbsG));
}

}  // namespace

void add_dataset_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("dataset",
                                         "Render images with known materials; the same command, or "
                                         "one with the folder alone, continues "
                                         "what was stopped");
  const auto options = std::make_shared<DatasetOptions>(*command);
  command->add_option("folder", options->folder, "Folder to write");
  CLI::Option* config =
      command->add_option("--config", options->config,
                          "Dataset file: what is drawn for each image (protobuf text format of "
                          "itn.v1.DatasetConfig); flags override it");
  command
      ->add_option("--preset", options->preset,
                   fmt::format("Instead: {}; default paper", description_of(dataset_presets())))
      ->excludes(config);
  command->add_flag("--print-config", options->print_config,
                    "Print the dataset file of the preset and the flags, and do nothing else");
  add_shape_flags(options->changes);
  add_image_flags(options->changes);
  add_format_flags(*command, options->json, "itn.v1.DatasetSummary");
  add_worker_flags(*command, options->workers);
  command->callback([options, command] { run(*options, *command); });
}

}  // namespace itn
