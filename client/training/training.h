// Training an encoder: regression networks (RN) and inverse transport networks (ITN) of Che et al.,
// ICCP 2020.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include <torch/torch.h>

#include "client/dataset/sampler.h"
#include "client/training/image_term.h"
#include "client/training/loss.h"
#include "client/training/packed_inputs.h"
#include "client/training/training_set.h"
#include "common/error.h"
#include "common/learning/encoder.h"
#include "common/learning/parameterization.h"

namespace itn {

// Throws Error (invalid input) that names the field.
void validate(const v1::TrainingConfig& config);

// Answers, loss, gradient or weights are not finite any more (invalid input): with these settings
// the training leads nowhere.
class Diverged : public Error {
 public:
  using Error::Error;
};

// The state of a training run. What it does depends on configuration, images and renders alone
// (and, in the last bits, on the number of torch's threads): a run that continues from a checkpoint
// ends with the same weights, bit for bit, as one that was never stopped. Torch draws no random
// numbers after the initial weights.
class Trainer {
 public:
  // A new run from random weights, or from those of `start` (a model trained before; its
  // coordinates, scale and bounds are kept). `image_term` is needed for the ITN loss only. Images
  // and inputs must outlive it.
  Trainer(v1::TrainingConfig config, const LabelledImages& images, const PackedInputs& inputs,
          const v1::Model& start, ImageTerm image_term);

  // Continues from a checkpoint of a trainer with the same configuration (it may have had fewer
  // steps) and model. Throws Error (invalid input) if it is not one.
  void restore(const v1::Checkpoint& checkpoint);
  v1::Checkpoint checkpoint() const;

  // One step on one batch. If it throws, the state is that before the step, unless the step itself
  // made the weights infinite. Throws Diverged, and what the image term throws.
  v1::TrainingMetrics step();

  // Throws Diverged unless the network answers the last batch with finite numbers.
  void require_finite_answers() const;

  uint64_t steps_taken() const { return state_.step(); }

 private:
  // What the network is shown of these items in a step.
  torch::Tensor inputs_of(std::span<const uint32_t> items, uint64_t step) const;
  Diverged diverged(const char* what) const;

  const LabelledImages& images_;
  const PackedInputs& inputs_;
  v1::Model model_;          // without weights
  v1::TrainingState state_;  // without the optimizer
  OutputSpace space_;
  torch::Tensor targets_;  // items x 3
  Encoder encoder_;
  std::unique_ptr<torch::optim::Adam> optimizer_;
  EpochSampler sampler_;
  std::unique_ptr<Loss> regression_loss_;
  std::unique_ptr<Loss> image_loss_;  // ITN
};

// A whole run in a folder that the caller has locked (FolderLock): metrics.jsonl (one
// TrainingMetrics a line) and the latest two checkpoints.
struct TrainingRun {
  std::filesystem::path folder;
  std::string dataset;              // its folder, for whoever continues the run
  uint64_t checkpoint_every = 100;  // steps
  std::function<void(const v1::TrainingMetrics&)> report;
  std::stop_token stop;
};

// Trains until `config.steps`, from where the run in the folder was stopped if there is one;
// `start` is for a new one. After a stop is requested, writes a checkpoint and throws Error
// (kCancelled); if the training diverges, keeps the checkpoints that there are and throws Error
// (invalid input). The same if the folder's run is of another configuration (says what differs;
// `steps` may).
void train(const v1::TrainingConfig& config, const LabelledImages& images,
           const PackedInputs& inputs, const v1::Model& start, const ImageTerm& image_term,
           const TrainingRun& run);

// Throws Error (invalid input) unless a run of the first configuration can go on with the second:
// says what differs, but for the number of steps, which may only not be below those taken.
void require_same_config(const v1::TrainingState& there, v1::TrainingConfig wanted,
                         const std::filesystem::path& folder);

}  // namespace itn
