// itn dataset: renders images of shapes under skies, with known materials.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/dataset/dataset_render.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/material.h"
#include "common/progress.h"

namespace itn {
namespace {

struct DatasetOptions {
  std::string folder;
  std::string shapes;  // folder; empty: the built-in ones
  bool repair = false;
  std::vector<std::string> test_shapes;
  uint32_t count = 400;
  bool grid = false;
  bool random = false;
  bool rotate = false;
  uint32_t resolution = 128;
  uint32_t spp = 256;
  uint64_t seed = 0;
  double test_fraction = 0.25;
  std::vector<double> train_azimuths, test_azimuths;
  std::pair<double, double> sigma_t{30, 276}, albedo{0.39, 0.95}, g{0, 0.8};
  WorkerFlags workers;
  bool json = false;
};

template <typename Values>
void replace(google::protobuf::RepeatedField<double>& field, const Values& values) {
  if (!values.empty()) {
    field.Assign(values.begin(), values.end());
  }
}

void set(v1::Interval* interval, const std::pair<double, double>& range) {
  interval->set_min(range.first);
  interval->set_max(range.second);
}

// What the flags say. A dataset that is continued has its configuration already: there only those
// that are on the command line count.
v1::DatasetConfig config_of(const DatasetOptions& options, const CLI::App& command,
                            const std::optional<v1::Dataset>& there) {
  const auto wanted = [&](const char* flag) { return !there || command.count(flag) > 0; };
  v1::DatasetConfig config = there ? there->config() : paper_config(options.resolution);
  if (wanted("--resolution")) {
    *config.mutable_set_up() = paper_config(options.resolution).set_up();
  }
  if (wanted("--spp")) {
    config.set_spp(options.spp);
  }
  if (wanted("--seed")) {
    config.set_seed(options.seed);
  }
  if (wanted("--rotate")) {
    config.set_rotate(options.rotate);
  }
  if (wanted("--test-fraction")) {
    config.set_test_fraction(options.test_fraction);
  }
  replace(*config.mutable_train_azimuths_degrees(), options.train_azimuths);
  replace(*config.mutable_test_azimuths_degrees(), options.test_azimuths);
  if (wanted("--sigma-t")) {
    set(config.mutable_materials()->mutable_sigma_t(), options.sigma_t);
  }
  if (wanted("--albedo")) {
    set(config.mutable_materials()->mutable_albedo(), options.albedo);
  }
  if (wanted("--g")) {
    set(config.mutable_materials()->mutable_g(), options.g);
  }
  if (options.grid) {
    config.set_sampling(v1::DatasetConfig::GRID);
    config.set_count(0);
  } else {
    if (!there || options.random) {
      config.set_sampling(options.random ? v1::DatasetConfig::RANDOM
                                         : v1::DatasetConfig::STRATIFIED);
    }
    if (wanted("--count")) {
      config.set_count(options.count);
    }
  }
  return config;
}

// The dataset that the folder holds, if it holds one.
std::optional<v1::Dataset> manifest_in(const std::string& folder) {
  const std::filesystem::path path = std::filesystem::path(folder) / kManifestName;
  return std::filesystem::exists(path) ? std::optional(read_manifest(path)) : std::nullopt;
}

// Where the dataset is there and no flag says anything else of it, the plan is what it holds;
// otherwise it is made anew, and render_dataset() says what differs from the one that is there.
DatasetPlan plan_of(const DatasetOptions& options, const CLI::App& command,
                    v1::DatasetSummary& summary) {
  const std::optional<v1::Dataset> there = manifest_in(options.folder);
  const v1::DatasetConfig config = config_of(options, command, there);
  if (there && options.shapes.empty() && options.test_shapes.empty()) {
    require_same_config(*there, config, options.folder);
    return {*there, {}};
  }
  const ShapeSet shapes =
      options.shapes.empty() ? builtin_shape_set() : load_shape_set(options.shapes, options.repair);
  for (const std::string& message : shapes.refused) {
    spdlog::warn("not used: {}", message);
    summary.add_refused_shapes(message);
  }
  return plan_dataset(config, shapes.shapes, options.test_shapes);
}

DatasetProgress render(const DatasetOptions& options, const DatasetPlan& plan, RenderPool& pool) {
  std::optional<Progress> progress;
  const DatasetProgress result = render_dataset(
      plan, options.folder, pool,
      [&](const DatasetProgress& now) {
        if (!progress) {
          progress.emplace("dataset", "images", now.total, now.done);
        }
        progress->update(now.done);
      },
      interruption());
  progress->finish();
  return result;
}

void describe(const v1::Dataset& manifest, v1::DatasetSummary& summary) {
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    shape.split() == v1::SPLIT_TRAIN ? summary.add_train_shapes(shape.name())
                                     : summary.add_test_shapes(shape.name());
  }
  uint32_t train = 0;
  for (const v1::DatasetItem& item : manifest.items()) {
    train += item.split() == v1::SPLIT_TRAIN ? 1 : 0;
  }
  summary.set_train_images(train);
  summary.set_test_images(static_cast<uint32_t>(manifest.items_size()) - train);
}

// Names as long as they can be read at a glance.
std::string names_of(const google::protobuf::RepeatedPtrField<std::string>& shapes) {
  constexpr int kMaxNames = 20;
  return shapes.size() <= kMaxNames ? fmt::format("{}", fmt::join(shapes, ", "))
                                    : fmt::format("{} shapes", shapes.size());
}

void print(const v1::DatasetSummary& summary) {
  print_result("{}: {} training images of {}; {} test images of {}\n", summary.folder(),
               summary.train_images(), names_of(summary.train_shapes()), summary.test_images(),
               names_of(summary.test_shapes()));
}

void run(const DatasetOptions& options, const CLI::App& command) {
  const auto start = std::chrono::steady_clock::now();
  check_folder_writable(options.folder);
  v1::DatasetSummary summary;
  summary.set_folder(options.folder);
  const DatasetPlan plan = plan_of(options, command, summary);
  describe(plan.manifest, summary);
  RenderPool pool(options.workers.pool_options());
  const DatasetProgress rendered = render(options, plan, pool);
  summary.set_kept(static_cast<uint32_t>(rendered.kept));
  summary.set_dropped_fraction(rendered.paths == 0 ? 0
                                                   : static_cast<double>(rendered.dropped) /
                                                         static_cast<double>(rendered.paths));
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  summary.set_seconds(elapsed.count());
  summary.set_render_cpu_seconds(pool.statistics().cpu_seconds);
  options.json ? print_result("{}\n", to_json(summary)) : print(summary);
}

}  // namespace

void add_dataset_command(CLI::App& app) {
  const auto options = std::make_shared<DatasetOptions>();
  CLI::App* command = app.add_subcommand("dataset",
                                         "Render images with known materials; the same command, or "
                                         "one with the folder alone, continues "
                                         "what was stopped");
  command->add_option("folder", options->folder, "Folder to write")->required();
  command->add_option("--shapes", options->shapes,
                      "Folder of closed PLY, OBJ or STL meshes; without: the built-in shapes");
  command->add_flag(
      "--repair", options->repair,
      "Close meshes of --shapes that are nearly closed: weld cracks, fill holes, turn "
      "triangles; says what it changed");
  command
      ->add_option(
          "--test-shapes", options->test_shapes,
          "Names of the shapes to test with, separated by commas; without: a random choice")
      ->delimiter(',');
  CLI::Option* count =
      command->add_option("--count", options->count, "Images, training and test together")
          ->check(number_in(2U, UINT32_MAX))
          ->capture_default_str();
  CLI::Option* grid =
      command
          ->add_flag("--grid", options->grid,
                     "All 300 materials of Che et al. 2020 for every shape and azimuth")
          ->excludes(count);
  command
      ->add_flag("--random", options->random, "Independent materials rather than a Latin hypercube")
      ->excludes(grid);
  command->add_flag("--rotate", options->rotate, "Turn each object about +y by a random angle");
  command->add_option("--resolution", options->resolution, "Pixels a side")
      ->check(one_of({"16", "32", "64", "128", "256"}))
      ->capture_default_str();
  command->add_option("--spp", options->spp, "Samples per pixel")
      ->check(kSppRange)
      ->capture_default_str();
  command->add_option("--seed", options->seed, "Of all choices")
      ->check(kAnySeed)
      ->capture_default_str();
  command->add_option("--test-fraction", options->test_fraction, "Of shapes and images")
      ->check(number_in(0.0, 1.0, Ends::kExcluded))
      ->capture_default_str();
  command
      ->add_option("--train-azimuths", options->train_azimuths,
                   "Of the sun, in degrees, separated by commas; default 0,30,60,90")
      ->check(number_in(-360.0, 360.0))
      ->delimiter(',');
  command
      ->add_option("--test-azimuths", options->test_azimuths, "Likewise; default 10,20,40,50,70,80")
      ->check(number_in(-360.0, 360.0))
      ->delimiter(',');
  const auto add_range = [&](const char* flag, std::pair<double, double>& range,
                             const std::string& description, const CLI::Validator& limits) {
    command->add_option(flag, range, description)
        ->type_name("MIN MAX")
        ->check(limits)
        ->excludes(grid)
        ->default_str(fmt::format("{} {}", range.first, range.second));
  };
  add_range("--sigma-t", options->sigma_t, "Of the materials, in 1/mm, log-uniform",
            number_in(kMinSigmaT, kMaxSigmaT));
  add_range("--albedo", options->albedo, "Of the materials, uniform", number_in(0.0, 1.0));
  add_range("--g", options->g, "Of the materials, uniform", number_in(-kMaxAbsG, kMaxAbsG));
  command->add_flag("--json", options->json, "Print the result as JSON (itn.v1.DatasetSummary)");
  add_worker_flags(*command, options->workers);
  command->callback([options, command] { run(*options, *command); });
}

}  // namespace itn
