#include "client/training/shuffled_colours.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "common/random.h"

namespace itn {

ShuffledColours::ShuffledColours(std::unique_ptr<Batches> batches, uint64_t seed)
    : batches_(std::move(batches)), seed_(seed) {}

TrainingImages ShuffledColours::batch_at(uint64_t step, uint32_t size) {
  TrainingImages result = batches_->batch_at(step, size);
  const auto channels = static_cast<size_t>(result.images.channels);
  if (channels == 1) return result;
  SplitMix random(derive_seed(seed_, {step}));
  std::vector<int64_t> source(static_cast<size_t>(result.images.planes()));
  std::iota(source.begin(), source.end(), 0);
  for (size_t first = 0; first < source.size(); first += channels) {
    for (size_t k = channels - 1; k > 0; --k) {
      std::swap(source[first + k], source[first + random.below(k + 1)]);
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
