#include "client/training/first_order_augmentation.h"

#include <utility>

#include <ATen/CPUGeneratorImpl.h>

#include "common/random.h"

namespace itn {
namespace {

MaterialCoordinates as_triple(const Material& m) {
  return {m.sigma_t, m.albedo, m.g};
}

bool is_inside(const MaterialCoordinates& point, const Box& box) {
  for (size_t k = 0; k < 3; ++k) {
    if (point[k] < box.min[k] || point[k] > box.max[k]) return false;
  }
  return true;
}

}  // namespace

FirstOrderAugmentation::FirstOrderAugmentation(std::unique_ptr<Batches> batches,
                                               const PackedDerivatives& derivatives,
                                               const v1::MaterialRange& bounds, double step,
                                               uint64_t seed)
    : batches_(std::move(batches)),
      derivatives_(derivatives),
      box_(to_box(bounds)),
      g_(g_interval(bounds)),
      step_(step),
      seed_(seed) {}

Material FirstOrderAugmentation::moved(const Material& material,
                                       const MaterialCoordinates& normal) const {
  MaterialCoordinates coordinates = to_coordinates(v1::UNBOUNDED, material, g_);
  for (size_t k = 0; k < 3; ++k) coordinates[k] += step_ * normal[k];
  const Material there = from_coordinates(v1::UNBOUNDED, coordinates, g_);
  return is_inside(as_triple(there), box_) ? there : material;
}

TrainingImages FirstOrderAugmentation::batch_at(uint64_t step, uint32_t size) {
  const torch::NoGradGuard no_gradient;
  TrainingImages result = batches_->batch_at(step, size);
  const auto count = static_cast<int64_t>(result.items.size());
  const torch::Tensor normals = torch::randn(
      {count, 3}, at::detail::createCPUGenerator(derive_seed(seed_, {step})), torch::kFloat64);
  const auto normal = normals.accessor<double, 2>();
  torch::Tensor steps = torch::empty({count, 3, 1, 1});
  for (int64_t i = 0; i < count; ++i) {
    Material& truth = result.truth[static_cast<size_t>(i)];
    const Material there = moved(truth, {normal[i][0], normal[i][1], normal[i][2]});
    for (size_t k = 0; k < 3; ++k) {
      steps[i][static_cast<int64_t>(k)] = as_triple(there)[k] - as_triple(truth)[k];
    }
    truth = there;
  }
  result.images.luminance =
      (result.images.luminance + (derivatives_.batch(result.items) * steps).sum(1)).clamp_min(0);
  return result;
}

}  // namespace itn
