#include "client/training/shuffled_colours.h"

#include <utility>
#include <vector>

#include "client/dataset/sampler.h"
#include "common/random.h"

namespace itn {

ShuffledColours::ShuffledColours(std::unique_ptr<Batches> batches, uint64_t seed)
    : batches_(std::move(batches)), seed_(seed) {}

TrainingImages ShuffledColours::batch_at(uint64_t step, uint32_t size) {
  TrainingImages result = batches_->batch_at(step, size);
  const auto channels = static_cast<uint32_t>(result.images.channels);
  if (channels == 1) return result;
  std::vector<int64_t> source;
  for (uint64_t image = 0; image < result.items.size(); ++image) {
    for (const uint32_t colour : permutation(channels, derive_seed(seed_, {step, image}))) {
      source.push_back(static_cast<int64_t>(image * channels + colour));
    }
  }
  const torch::Tensor order = torch::tensor(source);
  // Masks are those of all colours.
  result.images.luminance = result.images.luminance.index_select(0, order);
  if (result.images.noise.defined()) {
    result.images.noise = result.images.noise.index_select(0, order);
  }
  const std::vector<Material> truth = result.truth;
  for (size_t i = 0; i < truth.size(); ++i) {
    result.truth[i] = truth[static_cast<size_t>(source[i])];
  }
  return result;
}

}  // namespace itn
