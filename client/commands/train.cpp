// itn train: teaches an encoder network with a dataset.
#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>

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
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/render_pool/render_pool.h"
#include "client/training/training.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/checkpoint.h"
#include "common/progress.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using google::protobuf::util::MessageDifferencer;

struct TrainOptions {
  std::string dataset;
  std::string folder;
  std::string loss = "rn";
  std::string parameterization = "similarity";
  std::string init;
  std::optional<uint64_t> steps;
  std::optional<double> epochs;
  uint32_t batch = 60;
  double learning_rate = 1e-4;
  uint32_t base_channels = 16;
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

uint64_t steps_of(const TrainOptions& options, size_t items) {
  if (options.steps) {
    return *options.steps;
  }
  constexpr double kDefaultEpochs = 50;  // of the paper
  return static_cast<uint64_t>(std::ceil(options.epochs.value_or(kDefaultEpochs) *
                                         static_cast<double>(items) / options.batch));
}

v1::TrainingConfig config_of(const TrainOptions& options, const DatasetReader& dataset,
                             size_t items, const v1::Model& init) {
  v1::TrainingConfig config;
  config.set_loss(options.loss == "itn" ? v1::TrainingConfig::ITN : v1::TrainingConfig::RN);
  config.set_parameterization(options.parameterization == "naive" ? v1::NAIVE : v1::SIMILARITY);
  config.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(
      options.base_channels);
  config.set_output(v1::POINT);
  config.set_steps(steps_of(options, items));
  config.set_batch(options.batch);
  config.set_optimizer(v1::TrainingConfig::ADAM);
  config.set_schedule(v1::TrainingConfig::CONSTANT);
  config.set_learning_rate(options.learning_rate);
  config.set_seed(options.seed);
  if (config.loss() == v1::TrainingConfig::ITN) {
    config.set_spp(options.spp);
    config.set_estimates(options.estimates);
    config.set_pilot_spp(options.pilot_spp);
    if (options.lambda) {
      config.set_lambda(*options.lambda);
    }
  }
  config.set_dataset_sha256(to_hex(sha256(to_text(dataset.manifest()))));
  if (init.weights_size() > 0) {
    config.set_init_sha256(weights_sha256(init));
  }
  config.set_torch_threads(static_cast<uint32_t>(options.torch_threads));
  return config;
}

// The model to start from: one trained before, or one fitted to the dataset without weights.
v1::Model start_of(const TrainOptions& options, const v1::TrainingConfig& config,
                   const DatasetReader& dataset, const LabelledImages& images,
                   const v1::Model& init) {
  if (init.weights_size() == 0) {
    return fit_model(images, dataset.manifest().config().materials(), config);
  }
  const auto require_same = [&](const char* what, uint64_t there, uint64_t here) {
    if (there != here) {
      throw invalid_input(
          fmt::format("{}: its {} is {}, that of this run {}; they must be the same", options.init,
                      what, there, here));
    }
  };
  require_same("resolution", init.resolution(), static_cast<uint64_t>(images.resolution));
  if (!MessageDifferencer::Equals(init.architecture(), config.architecture()) ||
      init.output() != config.output()) {
    throw invalid_input(fmt::format("{}: its architecture is {}; this run needs the same",
                                    options.init, init.architecture().ShortDebugString()));
  }
  if (init.parameterization() != config.parameterization()) {
    throw invalid_input(fmt::format("{}: its parameterization is {}; this run needs the same",
                                    options.init,
                                    v1::Parameterization_Name(init.parameterization())));
  }
  return init;
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

void run(TrainOptions options) {
  const auto start = std::chrono::steady_clock::now();
  check_folder_writable(options.folder);
  if (options.torch_threads == 0) {
    options.torch_threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  }
  set_torch_threads(options.torch_threads);
  // Read.
  DatasetReader dataset(options.dataset);
  const LabelledImages images = load_images(dataset, v1::SPLIT_TRAIN, interruption());
  const v1::Model init = options.init.empty() ? v1::Model() : read_checkpoint(options.init).model();
  const v1::TrainingConfig config = config_of(options, dataset, images.items.size(), init);
  const v1::Model model = start_of(options, config, dataset, images, init);
  // Train.
  std::optional<RenderPool> pool;
  RenderBatch render;
  if (config.loss() == v1::TrainingConfig::ITN) {
    pool.emplace(options.workers.pool_options());
    render = render_with(dataset, *pool, config, interruption());
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
  train(config, images, model, render,
        {.folder = options.folder,
         .resume = options.resume,
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
  CLI::App* command = app.add_subcommand("train", "Train a network with a dataset");
  command->add_option("dataset", options->dataset, "Folder that itn dataset wrote")->required();
  command->add_option("-o,--output", options->folder, "Folder of the run")->required();
  command
      ->add_option("--loss", options->loss,
                   "rn: distance to the truth; itn: and of the re-rendered image to the input")
      ->check(CLI::IsMember({"rn", "itn"}))
      ->capture_default_str();
  command->add_option("--parameterization", options->parameterization, "Coordinates to learn")
      ->check(CLI::IsMember({"naive", "similarity"}))
      ->capture_default_str();
  command->add_option("--init", options->init,
                      "Checkpoint (or run) to start from, e.g. of an RN for an ITN");
  CLI::Option* steps =
      command->add_option("--steps", options->steps, "Steps to take")->check(CLI::PositiveNumber);
  command->add_option("--epochs", options->epochs, "Instead of steps; default 50")
      ->check(CLI::Range(0.0, 1e6))
      ->excludes(steps);
  command->add_option("--batch", options->batch, "Images per step")
      ->check(CLI::Range(1, 65536))
      ->capture_default_str();
  command->add_option("--lr", options->learning_rate, "Learning rate of Adam")
      ->capture_default_str();
  command->add_option("--base-channels", options->base_channels, "Of the first convolution")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->add_option("--spp", options->spp, "Samples per pixel of each render (itn)")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  command
      ->add_option("--estimates", options->estimates,
                   "Independent estimates that the samples are shared out to (itn)")
      ->check(CLI::Range(2, 16))
      ->capture_default_str();
  command
      ->add_option(
          "--pilot-spp", options->pilot_spp,
          "Samples per pixel of each render's pilot, which makes it quieter (itn); 0: none")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  command->add_option("--lambda", options->lambda,
                      "Weight of the image term (itn); default: balanced on the first ten steps");
  command->add_option("--seed", options->seed, "Of weights, order and renders")
      ->capture_default_str();
  command->add_option("--checkpoint-every", options->checkpoint_every, "Steps")
      ->check(CLI::Range(1, 1 << 30))
      ->capture_default_str();
  command->add_flag("--resume", options->resume,
                    "Continue from the run's checkpoint, if there is one");
  command
      ->add_option("--torch-threads", options->torch_threads,
                   "Threads of the network; 0: one per processor. The last bits depend on it")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print the result as JSON (itn.v1.TrainingSummary)");
  add_worker_flags(*command, options->workers);
  command->callback([options] { run(*options); });
}

}  // namespace itn
