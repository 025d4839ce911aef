#include "client/training/loss.h"

#include <utility>

#include "client/dataset/sampler.h"
#include "common/learning/gaussian.h"
#include "common/learning/weight_map.h"

namespace itn {
namespace {

MaterialCoordinates row(const torch::Tensor& doubles, size_t index) {
  const double* values = doubles[static_cast<int64_t>(index)].data_ptr<double>();
  return {values[0], values[1], values[2]};
}

}  // namespace

LossTerm RegressionLoss::evaluate(const Batch& batch, const torch::Tensor& outputs) {
  const torch::Tensor difference = outputs - batch.targets;
  return {difference.square().sum(1).mean().item<double>(), 2 * difference};
}

LossTerm LikelihoodLoss::evaluate(const Batch& batch, const torch::Tensor& outputs) {
  const torch::Tensor leaf = outputs.clone().requires_grad_();
  const torch::Tensor losses = negative_log_likelihood(leaf, batch.targets);
  const torch::Tensor means = mean_of(leaf, batch.targets.size(1));
  (losses.sum() + mean_weight_ * (means - batch.targets).square().sum()).backward();
  return {losses.mean().item<double>(), leaf.grad()};
}

std::unique_ptr<Loss> make_regression_loss(v1::OutputDistribution output, double mean_weight) {
  if (output == v1::GAUSSIAN) return std::make_unique<LikelihoodLoss>(mean_weight);
  return std::make_unique<RegressionLoss>();
}

std::vector<float> image_weights(const DatasetImage& image, int resolution,
                                 v1::TrainingConfig::ImageWeights weights) {
  return weights == v1::TrainingConfig::UNIFORM
             ? image.mask
             : weight_map(resolution, resolution, image.radiance, image.mask);
}

RerenderingLoss::RerenderingLoss(const OutputSpace& space, const LabelledImages& images,
                                 RerenderingEvaluator image_term,
                                 v1::TrainingConfig::ImageWeights weights, uint64_t seed)
    : space_(space),
      images_(images),
      rerendering_(std::move(image_term)),
      weights_(weights),
      seed_(seed) {}

LossTerm RerenderingLoss::evaluate(const Batch& batch, const torch::Tensor& outputs) {
  const size_t count = batch.items.size();
  const torch::Tensor predictions = outputs.to(torch::kFloat64);
  // Render every prediction, and compare it with its input.
  std::vector<std::vector<float>> images, weights;
  std::vector<RenderQuery> queries;
  for (size_t i = 0; i < count; ++i) {
    DatasetImage image = images_.read(batch.items[i]);
    weights.push_back(image_weights(image, images_.resolution, weights_));
    images.push_back(std::move(image.radiance));
    queries.push_back({.scene = images_.scene(batch.items[i]),
                       .material = space_.material(row(predictions, i)),
                       .seed = derive_seed(seed_, {batch.step, i}),
                       .image = images.back(),
                       .weight = weights.back()});
  }
  const std::vector<LossWithGradient> losses = rerendering_(queries);
  // Carry the gradients back to the outputs.
  LossTerm term;
  term.gradient = torch::zeros_like(outputs);
  auto gradient = term.gradient.accessor<float, 2>();
  for (size_t i = 0; i < count; ++i) {
    const std::vector<double>& g = losses[i].gradient;  // by sigma_t, albedo and g
    const MaterialCoordinates by_output =
        space_.output_gradient(row(predictions, i), {g.at(0), g.at(1), g.at(2)});
    for (size_t k = 0; k < 3; ++k) {
      gradient[static_cast<int64_t>(i)][static_cast<int64_t>(k)] = static_cast<float>(by_output[k]);
    }
    term.value += losses[i].value / static_cast<double>(count);
  }
  return term;
}

torch::Tensor surrogate_loss(const torch::Tensor& outputs, const torch::Tensor& gradients) {
  return (outputs * gradients.detach()).sum(1).mean();
}

}  // namespace itn
