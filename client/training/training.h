// Training an encoder: regression networks (RN) and inverse transport networks (ITN) of Che et al.,
// ICCP 2020.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <vector>

#include <torch/torch.h>

#include "client/dataset/sampler.h"
#include "client/training/training_set.h"
#include "common/learning/encoder.h"
#include "common/learning/parameterization.h"
#include "server/render/rendering_loss.h"

namespace itn {

class RenderPool;

// One render for the image term: the scene of an item with a predicted material, compared with the
// item's image.
struct RenderQuery {
  const v1::DatasetItem* item;
  Material material;
  std::span<const float> image, weight;  // by pixel
  uint64_t seed;
};

// For each query an unbiased estimate of the loss and its gradient. May throw Error.
using RenderBatch = std::function<std::vector<RenderingLoss>(std::span<const RenderQuery>)>;

// Renders all queries at the same time by a pool. Both must outlive the function.
RenderBatch render_with(DatasetReader& dataset, RenderPool& pool, const v1::TrainingConfig& config,
                        std::stop_token stop);

// A stand-in for a loss that torch cannot differentiate: its value means nothing; its gradient in
// `outputs` (batch x 3) is that of the mean over the batch of losses with these gradients (a
// constant to torch) in their outputs.
torch::Tensor stand_in(const torch::Tensor& outputs, const torch::Tensor& gradients);

// Throws Error (invalid input) that names the field.
void validate(const v1::TrainingConfig& config);

// The state of a training run. What it does depends on configuration, images and renders alone
// (and, in the last bits, on the number of torch's threads): a run that continues from a checkpoint
// ends with the same weights, bit for bit, as one that was never stopped. Torch draws no random
// numbers after the initial weights.
class Trainer {
 public:
  // A new run from random weights, or from those of `start` (a model trained before; its
  // coordinates, scale and bounds are kept). `render` is needed for the ITN loss only.
  Trainer(v1::TrainingConfig config, const LabelledImages& images, v1::Model start,
          RenderBatch render);

  // Continues from a checkpoint of the same configuration. Throws Error (kDataLoss) if it cannot be
  // read.
  void restore(const v1::Checkpoint& checkpoint);
  v1::Checkpoint checkpoint() const;

  // One step on one batch. If it throws, the state is that before the step.
  v1::TrainingMetrics step();

  uint64_t steps_taken() const { return state_.step(); }

 private:
  struct ImageTerm {
    double loss = 0;  // mean over the batch
    double lambda = 0;
    torch::Tensor gradient;  // batch x 3: of each item's loss in the network's outputs
  };
  ImageTerm image_term(std::span<const uint32_t> batch, const torch::Tensor& outputs,
                       const torch::Tensor& targets);
  double balance(const torch::Tensor& regression_gradient, const torch::Tensor& image_gradient);

  const LabelledImages& images_;
  RenderBatch render_;
  v1::Model model_;          // without weights
  v1::TrainingState state_;  // without the optimizer
  OutputSpace space_;
  torch::Tensor inputs_;   // items x 2 x resolution x resolution
  torch::Tensor targets_;  // items x 3
  Encoder encoder_;
  std::unique_ptr<torch::optim::Adam> optimizer_;
  EpochSampler sampler_;
};

// A whole run in a folder: metrics.jsonl (one TrainingMetrics a line) and the checkpoint.
struct TrainingRun {
  std::filesystem::path folder;
  bool resume = false;              // continue from the folder's checkpoint, if there is one
  uint64_t checkpoint_every = 100;  // steps
  std::function<void(const v1::TrainingMetrics&)> report;
  std::stop_token stop;
};

// Trains until `config.steps`. After a stop is requested, writes a checkpoint and throws Error
// (kCancelled). Throws Error (invalid input) if the folder has a checkpoint and `resume` is not
// set, or if that checkpoint is of another configuration (says what differs; `steps` may).
void train(const v1::TrainingConfig& config, const LabelledImages& images, const v1::Model& start,
           const RenderBatch& render, const TrainingRun& run);

}  // namespace itn
