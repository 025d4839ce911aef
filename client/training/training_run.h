// A training run in a folder: its checkpoints, what it tells of its steps, and how it goes on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "client/training/training.h"

namespace itn {

// The folder, which the caller has locked (FolderLock), has what MetricsLog and
// write_latest_checkpoint() write and, with validation, the best model.
struct TrainingRun {
  std::filesystem::path folder;
  std::string dataset;              // its folder, for whoever continues the run
  uint64_t checkpoint_every = 100;  // steps
  // What the model is called from now on; empty: what it is called already.
  std::string model_name, model_version;
  // Optional: how a model does on images that it has not learned from; asked every `validate_every`
  // steps and after the last. The best model is kept. After `patience` validations without a better
  // one the run ends; 0: never before the last step.
  std::function<v1::ValidationMetrics(const v1::Model&)> validate;
  uint64_t validate_every = 500;
  uint64_t patience = 0;
  // Optional: adds to a model that will not be trained any further what images tell of it (its
  // outlier_model, its calibration). At the end, to the last model and the best.
  std::function<void(v1::Model&)> complete;
  std::function<void(const v1::TrainingMetrics&)> report;
  std::stop_token stop;
};

struct TrainingEnd {
  bool stopped_early = false;
};

// Trains until `config.steps`, from where the run in the folder was stopped if there is one;
// `start` is for a new one. After a stop is requested, writes a checkpoint and throws Error
// (kCancelled); if the training diverges, keeps the checkpoints that there are and throws Diverged.
// Throws Error (invalid input) if the folder's run is of another configuration (says what differs;
// `steps` may).
TrainingEnd train(const v1::TrainingConfig& config, const LabelledImages& images,
                  const PackedInputs& inputs, const v1::Model& start,
                  const RerenderingEvaluator& image_term, const TrainingRun& run);

// Throws Error (invalid input) unless a run of the first configuration can go on with the second:
// says what differs, but for the number of steps, which may only not be below those taken.
void require_same_config(const v1::TrainingState& existing, v1::TrainingConfig wanted,
                         const std::filesystem::path& folder);

}  // namespace itn
