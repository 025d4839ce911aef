// Training an encoder: regression networks (RN) and inverse transport networks (ITN) of Che et al.,
// ICCP 2020.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <torch/types.h>

#include "client/training/batches.h"
#include "client/training/loss.h"
#include "client/training/optimizer.h"
#include "client/training/rerendering_loss.h"
#include "client/training/training_set.h"
#include "client/training/weight_average.h"
#include "common/error.h"
#include "common/learning/encoder.h"
#include "common/learning/parameterization.h"

namespace itn {

// Throws Error (invalid input) that names the field.
void validate(const v1::TrainingConfig& config);

// Whether images become those of other materials, for which the inputs need derivatives.
bool has_first_order_augmentation(const v1::TrainingConfig& config);

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
  // coordinates, scale and bounds are kept). `image_term` is needed for the ITN loss
  // only. Images and inputs must outlive it.
  Trainer(v1::TrainingConfig config, const LabelledImages& images, const PackedInputs& inputs,
          const v1::Model& start, RerenderingEvaluator image_term);

  // Continues from a checkpoint of a trainer with the same configuration (it may have had fewer
  // steps) and model. Throws Error (invalid input) if it is not one.
  void restore(const v1::Checkpoint& checkpoint);
  v1::Checkpoint checkpoint() const;

  // What the run has learned so far, with weights: their running mean, if the configuration has
  // one.
  v1::Model model() const;

  // One step on one batch. If it throws, the state is that before the step, unless the step itself
  // made the weights infinite. Throws Diverged, and what the image term throws.
  v1::TrainingMetrics step();

  // Throws Diverged unless the network answers the last batch with finite numbers.
  void require_finite_answers() const;

  uint64_t steps_taken() const { return state_.step(); }

 private:
  Trainer(v1::TrainingConfig config, std::unique_ptr<Batches> batches, const v1::Model& start);

  // What the network is shown of the images of a step.
  torch::Tensor input_of(const ImageBatch& images, uint64_t step) const;
  // One step of the optimizer along the gradient that the parameters hold.
  void descend(double rate);
  Diverged diverged(const char* what) const;

  std::unique_ptr<Batches> batches_;
  v1::Model model_;          // without weights
  v1::TrainingState state_;  // without the optimizer and the weights
  AnswerSpace space_;
  Encoder encoder_;
  Optimizer optimizer_;
  std::optional<WeightAverage> average_;
  std::unique_ptr<Loss> regression_loss_;
  std::unique_ptr<Loss> image_loss_;  // ITN
};

}  // namespace itn
