#include "client/training/training_run.h"

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <cmath>
#include <optional>
#include <utility>

#include "client/training/camera_augmentation.h"
#include "client/training/metrics_log.h"
#include "client/training/validation.h"
#include "common/error.h"
#include "common/learning/checkpoint.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

v1::TrainingMetrics timed_step(Trainer& trainer) {
  const auto start = std::chrono::steady_clock::now();
  v1::TrainingMetrics metrics = trainer.step();
  metrics.set_seconds(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return metrics;
}

// The best validation of a run so far, and the model that it was of.
class Best {
 public:
  Best(const TrainingRun& run, const v1::TrainingState& state) : run_(run) {
    if (state.has_best_score()) {
      score_ = state.best_score();
      step_ = state.best_step();
      since_ = state.validations_since();
    }
  }

  // Keeps the model if it is better than all before.
  void meet(const v1::Model& model, const v1::ValidationMetrics& metrics) {
    const double now = score(metrics);
    if (!std::isfinite(now) || now >= score_) {
      ++since_;
      return;
    }
    v1::Checkpoint checkpoint;
    *checkpoint.mutable_model() = model;
    write_checkpoint(run_.folder / kBestCheckpointName, std::move(checkpoint));
    score_ = now;
    step_ = model.step();
    since_ = 0;
  }

  bool patience_is_over() const { return run_.patience > 0 && since_ >= run_.patience; }

  void note_in(v1::TrainingState& state) const {
    if (std::isfinite(score_)) {
      state.set_best_score(score_);
      state.set_best_step(step_);
    }
    state.set_validations_since(since_);
  }

 private:
  const TrainingRun& run_;
  double score_ = HUGE_VAL;
  uint64_t step_ = 0;
  uint64_t since_ = 0;
};

// A run under way.
class Runner {
 public:
  // `finished`: the run's checkpoint is complete.
  Runner(Trainer& trainer, const TrainingRun& run, const v1::TrainingState& existing, bool finished)
      : trainer_(trainer),
        run_(run),
        best_(run, existing),
        log_(run.folder, trainer.steps_taken()),
        logged_(trainer.steps_taken()),
        saved_(trainer.steps_taken()),
        finished_(finished) {}

  uint64_t saved() const { return saved_; }

  // Whatever stops the run, what was learned is kept, unless that cannot be: of a full disk or of a
  // network that diverged (throws Diverged).
  void keep() {
    try {
      save();
    } catch (const Diverged&) {
      throw;
    } catch (const Error& error) {
      spdlog::warn("no checkpoint of step {}: {}", trainer_.steps_taken(), error.what());
    }
  }

  TrainingEnd until(uint64_t steps) {
    while (trainer_.steps_taken() < steps) {
      if (best_.patience_is_over()) {
        finish();
        return {.stopped_early = true};
      }
      if (run_.stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
      v1::TrainingMetrics metrics = timed_step(trainer_);
      const uint64_t step = trainer_.steps_taken();
      if (run_.validate && (step % run_.validate_every == 0 || step == steps)) {
        const v1::Model model = trainer_.model();
        *metrics.mutable_validation() = run_.validate(model);
        best_.meet(model, metrics.validation());
      }
      logged_ = step;
      log_.append(metrics);
      if (step % run_.checkpoint_every == 0 && step < steps) save();
      if (run_.report) run_.report(metrics);
    }
    finish();
    return {};
  }

  // Once for each step. A checkpoint is written only of a network that answers, and of steps whose
  // metrics are written: from what is there the run goes on without a gap.
  void save() {
    if (trainer_.steps_taken() == saved_) return;
    if (trainer_.steps_taken() != logged_) {
      throw Error(ErrorKind::kIo, "its validation did not end, and is to be done again");
    }
    log_.flush();
    write_latest_checkpoint(run_.folder, checkpoint());
    saved_ = trainer_.steps_taken();
    log_.draw();
  }

 private:
  v1::Checkpoint checkpoint() const {
    trainer_.require_finite_answers();
    v1::Checkpoint checkpoint = trainer_.checkpoint();
    v1::TrainingState& state = *checkpoint.mutable_training();
    state.set_dataset(run_.dataset);
    state.set_checkpoint_every(run_.checkpoint_every);
    state.set_validate_every(run_.validate_every);
    state.set_patience(run_.patience);
    best_.note_in(state);
    return checkpoint;
  }

  // The last checkpoint, and the best model, both complete.
  void finish() {
    if (!run_.complete || finished_) {
      save();
      return;
    }
    v1::Checkpoint last = checkpoint();
    run_.complete(*last.mutable_model());
    if (const fs::path path = run_.folder / kBestCheckpointName; fs::exists(path)) {
      v1::Checkpoint best = read_checkpoint(path);
      if (best.model().step() == last.model().step()) {
        *best.mutable_model() = last.model();
      } else {
        // What predictions must know of the training, for a run that an earlier version began.
        best.mutable_model()->set_noise(last.model().noise());
        best.mutable_model()->set_mirrored(last.model().mirrored());
        run_.complete(*best.mutable_model());
      }
      write_checkpoint(path, std::move(best));
    }
    if (trainer_.steps_taken() == saved_) {
      write_checkpoint(run_.folder / kCheckpointName, std::move(last));
      return;
    }
    write_latest_checkpoint(run_.folder, std::move(last));
    saved_ = trainer_.steps_taken();
    log_.draw();
  }

  Trainer& trainer_;
  const TrainingRun& run_;
  Best best_;
  MetricsLog log_;
  uint64_t logged_;  // step of the latest metrics that were given to the log
  uint64_t saved_;   // step of the latest checkpoint
  bool finished_;    // it is of the last step and complete
};

// For the message of a run that was stopped: where the next one begins.
std::string how_far(uint64_t steps, uint64_t saved) {
  if (steps == 0) return "";
  if (saved == 0)
    return fmt::format("; stopped after step {}, the same command begins anew", steps);
  return fmt::format(
      "; stopped after step {}, the same command continues{}, or --resume without the "
      "other flags",
      steps, saved < steps ? fmt::format(" after step {}", saved) : "");
}

// A zero that was said is as good as one that was not.
v1::TrainingConfig without_zeros(v1::TrainingConfig config) {
  v1::Augmentation& augmentation = *config.mutable_augmentation();
  if (!augmentation.mirror()) augmentation.clear_mirror();
  if (augmentation.shift() == 0) augmentation.clear_shift();
  if (augmentation.exposure() == 0) augmentation.clear_exposure();
  if (!changes_images(augmentation.camera())) augmentation.clear_camera();
  if (augmentation.first_order_step() == 0) augmentation.clear_first_order_step();
  if (!augmentation.shuffle_colours()) augmentation.clear_shuffle_colours();
  if (config.warmup_steps() == 0) config.clear_warmup_steps();
  if (config.weight_decay() == 0) config.clear_weight_decay();
  if (config.max_gradient_norm() == 0) config.clear_max_gradient_norm();
  if (config.weight_average_decay() == 0) config.clear_weight_average_decay();
  if (config.mean_weight() == 0) config.clear_mean_weight();
  return config;
}

}  // namespace

void require_same_config(const v1::TrainingState& existing, v1::TrainingConfig wanted,
                         const fs::path& folder) {
  if (wanted.steps() < existing.step()) {
    throw invalid_input(fmt::format("the run in {} has taken {} steps; {} are fewer",
                                    folder.string(), existing.step(), wanted.steps()));
  }
  wanted.set_steps(existing.config().steps());
  std::string text;
  google::protobuf::util::MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&text);
  if (!differencer.Compare(without_zeros(existing.config()), without_zeros(wanted))) {
    throw invalid_input(fmt::format(
        "the run in {} has another configuration; --resume continues it with its own (more steps "
        "are possible), or choose another folder. Differences:\n{}",
        folder.string(), text));
  }
}

TrainingEnd train(const v1::TrainingConfig& config, const LabelledImages& images,
                  const PackedInputs& inputs, const v1::Model& start,
                  const RerenderingEvaluator& image_term, const TrainingRun& run) {
  const std::optional<v1::Checkpoint> existing = find_checkpoint(run.folder);
  if (existing) require_same_config(existing->training(), config, run.folder);
  v1::Model from = existing ? existing->model() : start;
  if (!run.model_name.empty()) from.set_name(run.model_name);
  if (!run.model_version.empty()) from.set_version(run.model_version);
  Trainer trainer(config, images, inputs, from, image_term);
  if (existing) trainer.restore(*existing);
  Runner runner(trainer, run, existing ? existing->training() : v1::TrainingState(),
                existing && existing->model().has_outlier_model() &&
                    existing->training().step() == config.steps());
  try {
    try {
      return runner.until(config.steps());
    } catch (const Diverged&) {
      throw;
    } catch (const Error& error) {
      runner.keep();
      throw Error(error.kind(), error.what() + how_far(trainer.steps_taken(), runner.saved()));
    }
  } catch (const Diverged& error) {
    throw Diverged(error.kind(), fmt::format("{}. {}", error.what(),
                                             runner.saved() == 0
                                                 ? "No checkpoint was written"
                                                 : fmt::format("The checkpoint of step {} is kept",
                                                               runner.saved())));
  }
}

}  // namespace itn
