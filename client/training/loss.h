// The terms of a training loss. Each is a mean over the batch, and says by itself how it changes
// with the network's outputs; a trainer adds terms up without knowing what they are.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <torch/types.h>

#include "client/training/rerendering_loss.h"
#include "client/training/training_set.h"
#include "common/learning/parameterization.h"

namespace itn {

// What the network was shown in one step, and should have answered.
struct Batch {
  uint64_t step = 0;
  std::span<const uint32_t> items;  // their numbers in the LabelledImages
  torch::Tensor targets;            // labelled x 3: the truth of the first items, standardised
};

struct LossTerm {
  double value = 0;        // mean over the batch
  torch::Tensor gradient;  // batch x outputs: of each item's loss in its outputs
};

class Loss {
 public:
  virtual ~Loss() = default;
  // `outputs`: batch x outputs, a constant to torch; of a loss that takes targets, of the items
  // that have some. May throw Error.
  virtual LossTerm evaluate(const Batch& batch, const torch::Tensor& outputs) = 0;
};

// Squared distance of the prediction to the truth in standardised coordinates (Eq. 2).
class RegressionLoss final : public Loss {
 public:
  LossTerm evaluate(const Batch& batch, const torch::Tensor& outputs) override;
};

// Minus the log-density of the truth under the distribution that the network answers (gaussian.h).
// Its gradient is also that of the mean's squared distance to the truth, times a weight: the
// density alone leaves those images alone that the network is not sure of, and so never becomes.
class LikelihoodLoss final : public Loss {
 public:
  explicit LikelihoodLoss(double mean_weight) : mean_weight_(mean_weight) {}

  LossTerm evaluate(const Batch& batch, const torch::Tensor& outputs) override;

 private:
  double mean_weight_;
};

// The one that fits the output distribution. `mean_weight`: of LikelihoodLoss.
std::unique_ptr<Loss> make_regression_loss(v1::OutputDistribution output, double mean_weight);

// How much the pixels of an image count: w, in [0, 1].
std::vector<float> image_weights(const DatasetImage& image, int resolution,
                                 v1::TrainingConfig::ImageWeights weights);

// Distance of the re-rendered image to the input (Eq. 10), through the renderer's gradients. The
// material that is rendered is that of the first three outputs: the best guess, or the centre of
// the Gaussian.
class RerenderingLoss final : public Loss {
 public:
  // What is referred to must outlive it. `seed`: of the renders.
  RerenderingLoss(const OutputSpace& space, const LabelledImages& images,
                  RerenderingEvaluator image_term, v1::TrainingConfig::ImageWeights weights,
                  uint64_t seed);

  LossTerm evaluate(const Batch& batch, const torch::Tensor& outputs) override;

 private:
  const OutputSpace& space_;
  const LabelledImages& images_;
  RerenderingEvaluator rerendering_;
  v1::TrainingConfig::ImageWeights weights_;
  uint64_t seed_;
};

// A loss that torch can differentiate in the place of one that it cannot: its value means nothing;
// its gradient in `outputs` (batch x outputs) is that of the mean over the batch of losses with
// these gradients (a constant to torch) in their outputs.
torch::Tensor surrogate_loss(const torch::Tensor& outputs, const torch::Tensor& gradients);

}  // namespace itn
