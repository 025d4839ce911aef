// itn train: teaches an encoder network with a dataset.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/commands/options.h"
#include "client/commands/train.h"
#include "client/dataset/dataset.h"
#include "client/dataset/dataset_config.h"
#include "client/files/folder_lock.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/progress.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/text_proto.h"
#include "client/training/camera_augmentation.h"
#include "client/training/dataset_training.h"
#include "client/training/training_config.h"
#include "client/training/training_run.h"
#include "client/training/training_set.h"
#include "client/training/validation.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/checkpoint.h"
#include "common/learning/model_files.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

uint64_t steps_of(const TrainOptions& options, size_t items, uint32_t batch) {
  if (options.steps) return *options.steps;
  constexpr double kDefaultEpochs = 50;  // of the paper
  return static_cast<uint64_t>(
      std::ceil(options.epochs.value_or(kDefaultEpochs) * static_cast<double>(items) / batch));
}

// What the flags say.
class Flags {
 public:
  Flags(const TrainOptions& options, const CLI::App& command)
      : options_(options), command_(command) {}

  bool given(const char* flag) const { return command_.count(flag) > 0; }

  // The configuration of the run that is resumed, or of preset and file, but for what is on the
  // command line.
  v1::TrainingConfig applied_to(v1::TrainingConfig config) const {
    options_.changes.apply_to(config);
    if (!given("--mean-weight") && config.output() == v1::POINT) {
      config.clear_mean_weight();  // the preset's, of another output
    }
    if (given("--camera")) {
      v1::Augmentation& augmentation = *config.mutable_augmentation();
      augmentation.clear_camera();
      if (options_.camera) *augmentation.mutable_camera() = default_camera_augmentation();
    }
    clear_unused_loss_fields(config);
    return config;
  }

 private:
  const TrainOptions& options_;
  const CLI::App& command_;
};

// What a new run starts from.
v1::TrainingConfig base_config(const TrainOptions& options) {
  const v1::TrainingConfig preset = training_preset(options.preset);
  return options.config.empty() ? preset : read_training_config(options.config, preset);
}

// Throws unless a run of this configuration can start from a model trained before.
void require_same_network(const v1::Model& init, const v1::TrainingConfig& config, int resolution,
                          const std::string& name) {
  const auto require_same = [&](const char* what, const std::string& existing,
                                const std::string& here) {
    if (existing != here) {
      throw invalid_input(
          fmt::format("{}: its {} is {}, that of this run {}; they must be the same", name, what,
                      existing, here));
    }
  };
  require_same("resolution", std::to_string(init.resolution()), std::to_string(resolution));
  require_same("input", v1::NetworkInput_Name(init.input()), v1::NetworkInput_Name(config.input()));
  require_same("architecture", init.architecture().ShortDebugString(),
               config.architecture().ShortDebugString());
  require_same("output distribution", v1::OutputDistribution_Name(init.output()),
               v1::OutputDistribution_Name(config.output()));
  require_same("number of components", std::to_string(std::max(1U, init.components())),
               std::to_string(std::max(1U, config.components())));
  require_same("parameterization", v1::Parameterization_Name(init.parameterization()),
               v1::Parameterization_Name(config.parameterization()));
}

std::string note_of(const v1::TrainingMetrics& metrics) {
  std::string note = fmt::format("regression {:.4f}", metrics.regression_loss());
  if (metrics.has_image_loss()) note += fmt::format("  image {:.5f}", metrics.image_loss());
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
  if (summary.has_best()) {
    const v1::ValidationMetrics& best = summary.best();
    print_result(
        "{}: best on the validation split{}: errors of {:.3f} (sigma_t), {:.3f} (albedo), {:.3f} "
        "(g) of the constant predictor's\n",
        summary.best_checkpoint(), summary.stopped_early() ? ", no better one came" : "",
        best.sigma_t(), best.albedo(), best.g());
  }
}

// What is told of a call: how far it is, and in the end what became of it.
class TrainingReport {
 public:
  void add(const v1::TrainingMetrics& metrics, uint64_t steps) {
    if (!progress_) progress_.emplace("train", "steps", steps, metrics.step() - 1);
    if (metrics.has_validation()) {
      const v1::ValidationMetrics& v = metrics.validation();
      validated_ = fmt::format("  validation {:.3f} {:.3f} {:.3f}", v.sigma_t(), v.albedo(), v.g());
      if (!summary_.has_best() || score(v) < score(summary_.best())) *summary_.mutable_best() = v;
    }
    progress_->update(metrics.step(), note_of(metrics) + validated_);
    *summary_.mutable_last() = metrics;
  }

  // `pool` is null if nothing was rendered.
  v1::TrainingSummary summary(const fs::path& folder, const TrainingEnd& end, bool has_validation,
                              const RenderPool* pool) {
    if (progress_) progress_->finish();
    const fs::path checkpoint = folder / kCheckpointName;
    summary_.set_checkpoint(checkpoint.string());
    summary_.set_model(read_checkpoint(checkpoint).model().name());
    summary_.set_stopped_early(end.stopped_early);
    if (has_validation) summary_.set_best_checkpoint((folder / kBestCheckpointName).string());
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
    summary_.set_seconds(elapsed.count());
    summary_.set_render_cpu_seconds(pool != nullptr ? pool->statistics().cpu_seconds : 0);
    return summary_;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::optional<Progress> progress_;
  std::string validated_;  // as it is shown
  v1::TrainingSummary summary_;
};

// The dataset: the one that is named, or the one that the run was started with.
std::string dataset_folder(const TrainOptions& options,
                           const std::optional<v1::Checkpoint>& existing) {
  if (!options.dataset.empty()) return options.dataset;
  if (!existing && options.resume) {
    throw Error(ErrorKind::kIo,
                fmt::format("there is no run in {} to continue; itn train DATASET -o {} begins one",
                            options.folder, options.folder));
  }
  if (!options.resume) {
    throw Error(ErrorKind::kUsage,
                "which dataset? itn train DATASET -o RUN (only a run that is "
                "resumed knows it: itn train --resume -o RUN)");
  }
  const std::string& folder = existing->training().dataset();
  if (folder.empty()) {
    throw invalid_input(
        fmt::format("the run in {} learned from a stream of renders, which itn 0.2 has no more; "
                    "itn train DATASET -o RUN --init {} goes on from its model",
                    options.folder, options.folder));
  }
  if (!fs::exists(folder)) {
    throw Error(ErrorKind::kIo,
                fmt::format("the dataset of this run was in {} and is not there any more; where is "
                            "it? itn train DATASET --resume -o {}",
                            folder, options.folder));
  }
  return folder;
}

// One call: what it was told, and its folder.
class Training {
 public:
  Training(const TrainOptions& options, const CLI::App& command)
      : options_(options),
        flags_(options, command),
        lock_(options.folder, "itn train"),
        existing_(find_checkpoint(options.folder)),
        init_(options.init.empty()
                  ? std::nullopt
                  : std::optional(read_checkpoint(find_model(options.init)).model())) {
    lock_.remove_temporary_files();
    if (options_.torch_threads == 0) {
      options_.torch_threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    }
  }

  const std::optional<v1::Checkpoint>& existing_run() const { return existing_; }
  bool goes_on() const { return existing_ && options_.resume; }
  const Flags& flags() const { return flags_; }
  const TrainOptions& options() const { return options_; }

  // What preset, file, flags and the run that goes on say together.
  v1::TrainingConfig config() const {
    return flags_.applied_to(goes_on() ? existing_->training().config() : base_config(options_));
  }

  // What follows from the rest. `images`: of an epoch.
  void complete(v1::TrainingConfig& config, size_t images) const {
    if (config.steps() == 0 || flags_.given("--steps") || flags_.given("--epochs")) {
      config.set_steps(steps_of(options_, images, config.batch()));
    }
    if (!goes_on() && !flags_.given("--warmup-steps")) {  // not most of a short run
      config.set_warmup_steps(std::min(config.warmup_steps(), config.steps() / 10));
    }
    if (!goes_on() || flags_.given("--network-threads")) {
      config.set_torch_threads(static_cast<uint32_t>(options_.torch_threads));
    }
    if (!goes_on() || flags_.given("--init")) {
      config.set_init_sha256(init_ ? weights_sha256(*init_) : "");
    }
  }

  // Throws unless the run can be trained like this.
  void check(const v1::TrainingConfig& config, int resolution) {
    if (existing_) {
      require_same_config(existing_->training(), config, options_.folder);
      if (options_.resume) remember(existing_->training());
    } else if (init_) {
      require_same_network(*init_, config, resolution, options_.init);
    }
  }

  // The model of the run that goes on, or of the one that a new run starts from.
  std::optional<v1::Model> start() const { return existing_ ? existing_->model() : init_; }

  // The run that the options ask for, without what it reports to.
  TrainingRun run() const {
    TrainingRun run;
    run.folder = options_.folder;
    run.checkpoint_every = options_.checkpoint_every;
    run.model_name = model_name();
    run.model_version = options_.model_version;
    run.validate_every = options_.validate_every;
    run.patience = options_.patience;
    run.stop = interruption();
    return run;
  }

 private:
  // How the run that goes on was kept, but for what is on the command line.
  void remember(const v1::TrainingState& existing) {
    if (!flags_.given("--checkpoint-every")) {
      options_.checkpoint_every = std::max<uint64_t>(1, existing.checkpoint_every());
    }
    if (!flags_.given("--validate-every") && existing.has_validate_every()) {
      options_.validate_every = existing.validate_every();
    }
    if (!flags_.given("--patience")) options_.patience = existing.patience();
  }

  // What was asked for; of a new run that of its folder.
  std::string model_name() const {
    if (!options_.model_name.empty() || existing_) return options_.model_name;
    fs::path folder = fs::absolute(options_.folder).lexically_normal();
    if (!folder.has_filename()) folder = folder.parent_path();
    return as_model_name(folder.filename().string());
  }

  TrainOptions options_;
  Flags flags_;
  FolderLock lock_;
  std::optional<v1::Checkpoint> existing_;
  std::optional<v1::Model> init_;
};

}  // namespace

void run_train(const TrainOptions& given, const CLI::App& command) {
  if (given.print_config) {
    print_result("{}", to_text_proto(Flags(given, command).applied_to(base_config(given))));
    return;
  }
  if (given.folder.empty()) throw Error(ErrorKind::kUsage, "where to? itn train DATASET -o RUN");
  check_folder_writable(given.folder);
  TrainingReport report;
  Training training(given, command);
  const TrainOptions& options = training.options();
  DatasetReader dataset(dataset_folder(options, training.existing_run()));
  // What is asked for.
  v1::TrainingConfig config = training.config();
  config.set_dataset_sha256(to_hex(sha256(to_text(dataset.manifest()))));
  training.complete(config, images_of(dataset, v1::SPLIT_TRAIN).items.size());
  training.check(config, resolution_of(config, dataset.resolution()));
  // Read, and train.
  TrainingRun run = training.run();
  run.report = [&](const v1::TrainingMetrics& metrics) { report.add(metrics, config.steps()); };
  std::optional<RenderPool> pool;
  DatasetTraining dataset_training(config, dataset, training.start(), std::move(run));
  const TrainingEnd end = dataset_training.train(
      [&]() -> JobRenderer& { return pool.emplace(options.workers.pool_options()); });
  const v1::TrainingSummary summary = report.summary(
      options.folder, end, dataset_training.has_validation(), pool ? &*pool : nullptr);
  options.json ? print_result("{}\n", to_json(summary)) : print(summary);
}

}  // namespace itn
