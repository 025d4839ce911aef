// itn train: teaches an encoder network with a dataset.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/dataset/dataset.h"
#include "client/dataset/dataset_config.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/render_pool/render_pool.h"
#include "client/training/training.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/folder_lock.h"
#include "common/flags.h"
#include "common/learning/checkpoint.h"
#include "common/progress.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

struct TrainOptions {
  std::string dataset;
  std::string folder;
  std::string loss = "rn";
  std::string parameterization;
  std::string distribution;
  std::string exposure = "known";
  uint32_t resolution = 0;
  double noise = 0;
  std::string init;
  std::optional<uint64_t> steps;
  std::optional<double> epochs;
  uint32_t batch = 60;
  double learning_rate = 1e-4;
  std::string architecture = "paper";
  std::optional<uint32_t> base_channels;
  uint32_t blocks = 1;
  uint32_t spp = 256;
  uint32_t estimates = 4;
  uint32_t pilot_spp = 4;
  std::optional<double> lambda;
  uint64_t seed = 0;
  uint64_t checkpoint_every = 100;
  bool resume = false;
  int torch_threads = 0;
  WorkerFlags workers;
  bool json = false;
};

uint64_t steps_of(const TrainOptions& options, size_t items, uint32_t batch) {
  if (options.steps) {
    return *options.steps;
  }
  constexpr double kDefaultEpochs = 50;  // of the paper
  return static_cast<uint64_t>(
      std::ceil(options.epochs.value_or(kDefaultEpochs) * static_cast<double>(items) / batch));
}

// What the flags say. A run that is resumed has its configuration already: there only those that
// are on the command line count.
class Flags {
 public:
  Flags(const TrainOptions& options, const CLI::App& command)
      : options_(options), command_(command) {}

  bool given(const char* flag) const { return command_.count(flag) > 0; }

  // The configuration `known` where there is one.
  v1::TrainingConfig config(const v1::TrainingConfig* known, const DatasetReader& dataset,
                            size_t items, const std::optional<v1::Model>& init) const {
    v1::TrainingConfig config = known == nullptr ? v1::TrainingConfig() : *known;
    const auto wanted = [&](const char* flag) { return known == nullptr || given(flag); };
    if (wanted("--loss")) {
      config.set_loss(options_.loss == "itn" ? v1::TrainingConfig::ITN : v1::TrainingConfig::RN);
    }
    if (wanted("--architecture") || given("--base-channels") || given("--blocks")) {
      set_architecture(known, config);
    }
    const bool residual = config.architecture().has_residual_convolutions();
    if (wanted("--distribution") || given("--architecture")) {
      config.set_output(gaussian(residual) ? v1::GAUSSIAN : v1::POINT);
    }
    if (wanted("--parameterization") || given("--distribution") || given("--architecture")) {
      config.set_parameterization(parameterization(config.output()));
    }
    if (wanted("--exposure")) {
      config.set_exposure(options_.exposure == "unknown" ? v1::EXPOSURE_UNKNOWN
                                                         : v1::EXPOSURE_KNOWN);
    }
    if (wanted("--resolution")) {
      config.set_resolution(options_.resolution);
    }
    if (wanted("--noise")) {
      config.set_noise(options_.noise);
    }
    if (wanted("--batch")) {
      config.set_batch(options_.batch);
    }
    if (wanted("--steps") || given("--epochs")) {
      config.set_steps(steps_of(options_, items, config.batch()));
    }
    if (wanted("--lr")) {
      config.set_learning_rate(options_.learning_rate);
    }
    if (wanted("--seed")) {
      config.set_seed(options_.seed);
    }
    const bool itn = config.loss() == v1::TrainingConfig::ITN;
    if (itn && wanted("--spp")) {
      config.set_spp(options_.spp);
    }
    if (itn && wanted("--estimates")) {
      config.set_estimates(options_.estimates);
    }
    if (itn && wanted("--pilot-spp")) {
      config.set_pilot_spp(options_.pilot_spp);
    }
    if (itn && options_.lambda) {
      config.set_lambda(*options_.lambda);
    }
    if (wanted("--torch-threads")) {
      config.set_torch_threads(static_cast<uint32_t>(options_.torch_threads));
    }
    if (wanted("--init")) {
      config.set_init_sha256(init ? weights_sha256(*init) : "");
    }
    if (known == nullptr) {  // there is one of each
      config.set_optimizer(v1::TrainingConfig::ADAM);
      config.set_schedule(v1::TrainingConfig::CONSTANT);
    }
    config.set_dataset_sha256(to_hex(sha256(to_text(dataset.manifest()))));
    return config;
  }

 private:
  // The paper's, or the residual one; a width that is not given is that of `known`, or a default.
  void set_architecture(const v1::TrainingConfig* known, v1::TrainingConfig& config) const {
    const bool residual = known == nullptr || given("--architecture")
                              ? options_.architecture == "residual"
                              : known->architecture().has_residual_convolutions();
    v1::Architecture& architecture = *config.mutable_architecture();
    if (residual) {
      v1::ResidualConvolutions& sizes = *architecture.mutable_residual_convolutions();
      if (options_.base_channels || sizes.base_channels() == 0) {
        sizes.set_base_channels(options_.base_channels.value_or(32));
      }
      if (given("--blocks") || sizes.blocks() == 0) {
        sizes.set_blocks(options_.blocks);
      }
      config.set_input(v1::RATIOS);
    } else {
      v1::PlainConvolutions& sizes = *architecture.mutable_plain_convolutions();
      if (options_.base_channels || sizes.base_channels() == 0) {
        sizes.set_base_channels(options_.base_channels.value_or(16));
      }
      config.set_input(v1::LUMINANCE_AND_WEIGHT);
    }
  }

  bool gaussian(bool residual) const {
    return options_.distribution.empty() ? residual : options_.distribution == "gaussian";
  }

  v1::Parameterization parameterization(v1::OutputDistribution output) const {
    if (options_.parameterization.empty()) {
      return output == v1::GAUSSIAN ? v1::UNBOUNDED : v1::SIMILARITY;
    }
    return options_.parameterization == "naive"        ? v1::NAIVE
           : options_.parameterization == "similarity" ? v1::SIMILARITY
                                                       : v1::UNBOUNDED;
  }

  const TrainOptions& options_;
  const CLI::App& command_;
};

// Throws unless a run of this configuration can start from a model trained before.
void require_same_network(const v1::Model& init, const v1::TrainingConfig& config, int resolution,
                          const std::string& name) {
  const auto require_same = [&](const char* what, const std::string& there,
                                const std::string& here) {
    if (there != here) {
      throw invalid_input(fmt::format(
          "{}: its {} is {}, that of this run {}; they must be the same", name, what, there, here));
    }
  };
  require_same("resolution", std::to_string(init.resolution()), std::to_string(resolution));
  require_same("input", v1::NetworkInput_Name(init.input()), v1::NetworkInput_Name(config.input()));
  require_same("exposure", v1::Exposure_Name(init.exposure()),
               v1::Exposure_Name(config.exposure()));
  require_same("architecture", init.architecture().ShortDebugString(),
               config.architecture().ShortDebugString());
  require_same("output distribution", v1::OutputDistribution_Name(init.output()),
               v1::OutputDistribution_Name(config.output()));
  require_same("parameterization", v1::Parameterization_Name(init.parameterization()),
               v1::Parameterization_Name(config.parameterization()));
}

std::string note_of(const v1::TrainingMetrics& metrics) {
  std::string note = fmt::format("regression {:.4f}", metrics.regression_loss());
  if (metrics.has_image_loss()) {
    note += fmt::format("  image {:.5f}", metrics.image_loss());
  }
  return note;
}

void print(const v1::TrainingSummary& summary) {
  if (!summary.has_last()) {
    print_result("{}: {}, was finished already\n", summary.checkpoint(), summary.model());
    return;
  }
  print_result("{}: {}, step {}, regression loss {:.4f}", summary.checkpoint(), summary.model(),
               summary.last().step(), summary.last().regression_loss());
  if (summary.last().has_image_loss()) {
    print_result(", image loss {:.5f}", summary.last().image_loss());
  }
  print_result(", {:.1f} s\n", summary.seconds());
}

// The dataset: the one that is named, or the one that the run was started with.
std::string dataset_folder(const TrainOptions& options,
                           const std::optional<v1::Checkpoint>& there) {
  if (!options.dataset.empty()) {
    return options.dataset;
  }
  if (!there && options.resume) {
    throw Error(ErrorKind::kIo,
                fmt::format("there is no run in {} to continue; itn train DATASET -o {} begins one",
                            options.folder, options.folder));
  }
  if (!options.resume) {
    throw Error(ErrorKind::kUsage,
                "which dataset? itn train DATASET -o RUN (only a run that is "
                "resumed knows it: itn train --resume -o RUN)");
  }
  const std::string& folder = there->training().dataset();
  if (!fs::exists(folder)) {
    throw Error(ErrorKind::kIo,
                fmt::format("the dataset of this run was in {} and is not there any more; where is "
                            "it? itn train DATASET --resume -o {}",
                            folder, options.folder));
  }
  return folder;
}

void run(TrainOptions options, const CLI::App& command) {
  const auto start = std::chrono::steady_clock::now();
  check_folder_writable(options.folder);
  if (options.torch_threads == 0) {
    options.torch_threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  }
  // What is asked for.
  const FolderLock lock(options.folder, "itn train");
  lock.remove_temporary_files();
  const std::optional<v1::Checkpoint> there = find_checkpoint(options.folder);
  DatasetReader dataset(dataset_folder(options, there));
  const LabelledImages images = images_of(dataset, v1::SPLIT_TRAIN);
  const std::optional<v1::Model> init =
      options.init.empty() ? std::nullopt : std::optional(read_checkpoint(options.init).model());
  const Flags flags(options, command);
  const v1::TrainingConfig config =
      flags.config(there && options.resume ? &there->training().config() : nullptr, dataset,
                   images.items.size(), init);
  const int resolution =
      config.resolution() != 0 ? static_cast<int>(config.resolution()) : images.resolution;
  if (there) {
    require_same_config(there->training(), config, options.folder);
    if (!flags.given("--checkpoint-every") && options.resume) {
      options.checkpoint_every = std::max<uint64_t>(1, there->training().checkpoint_every());
    }
  } else if (init) {
    require_same_network(*init, config, resolution, options.init);
  }
  validate(config);
  // Read.
  set_torch_threads(static_cast<int>(config.torch_threads()));
  const PackedInputs inputs(images, {.resolution = resolution, .input = config.input()},
                            options.folder, interruption());
  v1::Model model;  // of a new run
  if (!there) {
    model = init ? *init
                 : fit_model(images, inputs.mean_radiance(),
                             material_range(dataset.manifest().config()), config);
  }
  // Train.
  std::optional<RenderPool> pool;
  ImageTerm image_term;
  if (config.loss() == v1::TrainingConfig::ITN) {
    pool.emplace(options.workers.pool_options());
    image_term = rendered_image_term(
        *pool,
        {.spp = config.spp(), .estimates = config.estimates(), .pilot_spp = config.pilot_spp()},
        interruption());
  }
  v1::TrainingSummary summary;
  std::optional<Progress> progress;
  const auto report = [&](const v1::TrainingMetrics& metrics) {
    if (!progress) {
      progress.emplace("train", "steps", config.steps(), metrics.step() - 1);
    }
    progress->update(metrics.step(), note_of(metrics));
    *summary.mutable_last() = metrics;
  };
  train(config, images, inputs, model, image_term,
        {.folder = options.folder,
         .dataset = fs::absolute(dataset.folder()).lexically_normal().string(),
         .checkpoint_every = options.checkpoint_every,
         .report = report,
         .stop = interruption()});
  if (progress) {
    progress->finish();
  }
  // Report.
  const fs::path checkpoint = fs::path(options.folder) / kCheckpointName;
  summary.set_checkpoint(checkpoint.string());
  summary.set_model(read_checkpoint(checkpoint).model().name());
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  summary.set_seconds(elapsed.count());
  summary.set_render_cpu_seconds(pool ? pool->statistics().cpu_seconds : 0);
  options.json ? print_result("{}\n", to_json(summary)) : print(summary);
}

}  // namespace

void add_train_command(CLI::App& app) {
  const auto options = std::make_shared<TrainOptions>();
  CLI::App* command = app.add_subcommand(
      "train",
      "Train a network with a dataset; the same command continues what was stopped. The optimizer "
      "is Adam, at a constant learning rate");
  command->add_option("dataset", options->dataset,
                      "Folder that itn dataset wrote; --resume knows it");
  command->add_option("-o,--output", options->folder, "Folder of the run")->required();
  command
      ->add_option("--loss", options->loss,
                   "rn: distance to the truth; itn: and of the re-rendered image to the input")
      ->check(one_of({"rn", "itn"}))
      ->capture_default_str();
  command
      ->add_option("--distribution", options->distribution,
                   "What the network answers; point: a best guess; gaussian: a distribution; "
                   "default: gaussian for the residual architecture, otherwise point")
      ->check(one_of({"point", "gaussian"}));
  command
      ->add_option("--parameterization", options->parameterization,
                   "Coordinates to learn; default: unbounded for a gaussian, otherwise similarity")
      ->check(one_of({"naive", "similarity", "unbounded"}));
  command
      ->add_option(
          "--exposure", options->exposure,
          "Whether the radiance of photographs will be on the dataset's scale; unknown: the "
          "network learns to do without")
      ->check(one_of({"known", "unknown"}))
      ->capture_default_str();
  command
      ->add_option("--resolution", options->resolution,
                   "Of the network's input, in pixels: the images are averaged down; 0: their own")
      ->check(one_of({"0", "16", "32", "64", "128", "256"}))
      ->capture_default_str();
  command
      ->add_option("--noise", options->noise,
                   "Relative noise of a pixel that every image is brought up to, afresh in each "
                   "step, so that noise tells nothing of the material; 0: none is added")
      ->check(number_in(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--init", options->init,
                      "Checkpoint (or run) to start from, e.g. of an RN for an ITN");
  CLI::Option* steps = command->add_option("--steps", options->steps, "Steps to take")
                           ->check(number_in(uint64_t{1}, uint64_t{UINT32_MAX}));
  command->add_option("--epochs", options->epochs, "Instead of steps; default 50")
      ->check(number_in(0.0, 1e6, Ends::kExcluded))
      ->excludes(steps);
  command->add_option("--batch", options->batch, "Images per step")
      ->check(number_in(1U, 65536U))
      ->capture_default_str();
  command->add_option("--lr", options->learning_rate, "Learning rate of Adam, constant")
      ->check(number_in(0.0, 1e30, Ends::kExcluded))
      ->capture_default_str();
  command
      ->add_option("--architecture", options->architecture,
                   "Layers of the network; paper: convolution, ReLU and pooling down to one pixel, "
                   "of luminance and weight map; residual: a residual network of log luminance and "
                   "its ratios to means")
      ->check(one_of({"paper", "residual"}))
      ->capture_default_str();
  command
      ->add_option("--base-channels", options->base_channels,
                   "Of the first convolution; default: 16 (paper), 32 (residual)")
      ->check(number_in(1U, 128U));
  command->add_option("--blocks", options->blocks, "Of each stage (residual)")
      ->check(number_in(1U, 4U))
      ->capture_default_str();
  command->add_option("--spp", options->spp, "Samples per pixel of each render (itn)")
      ->check(kSppRange)
      ->capture_default_str();
  command
      ->add_option("--estimates", options->estimates,
                   "Independent estimates that the samples are shared out to (itn)")
      ->check(number_in(2U, 16U))
      ->capture_default_str();
  command
      ->add_option(
          "--pilot-spp", options->pilot_spp,
          "Samples per pixel of each render's pilot, which makes it quieter (itn); 0: none")
      ->check(number_in(0U, 64U))
      ->capture_default_str();
  command
      ->add_option("--lambda", options->lambda,
                   "Weight of the image term (itn); default: balanced on the first ten steps")
      ->check(number_in(0.0, 1e30));
  command->add_option("--seed", options->seed, "Of weights, order and renders")
      ->check(kAnySeed)
      ->capture_default_str();
  command->add_option("--checkpoint-every", options->checkpoint_every, "Steps")
      ->check(number_in(uint64_t{1}, uint64_t{1} << 30))
      ->capture_default_str();
  command->add_flag(
      "--resume", options->resume,
      "Continue the folder's run, if there is one: its flags, the dataset too, need not "
      "be given again, and those that are must be the same; --steps may be more");
  command
      ->add_option("--torch-threads", options->torch_threads,
                   "Threads of the network; 0: one per processor. The last bits depend on it: a "
                   "run keeps the number that it began with. To go on by the same command on "
                   "a machine of other processors, give the number; --resume knows it")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print the result as JSON (itn.v1.TrainingSummary)");
  add_worker_flags(*command, options->workers);
  command->callback([options, command] { run(*options, *command); });
}

}  // namespace itn
