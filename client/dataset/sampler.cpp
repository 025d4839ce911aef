#include "client/dataset/sampler.h"

#include <numeric>
#include <utility>

namespace itn {

std::vector<uint32_t> permutation(uint32_t count, uint64_t seed) {
  std::vector<uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0U);
  SplitMix random(seed);
  // Fisher-Yates.
  for (uint32_t i = count; i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
  return order;
}

std::vector<uint32_t> EpochSampler::batch(uint64_t step, uint32_t size) {
  std::vector<uint32_t> items(size);
  for (uint32_t i = 0; i < size; ++i) items[i] = item(step * size + i);
  return items;
}

uint32_t EpochSampler::item(uint64_t position) {
  const uint64_t epoch = position / count_;
  if (epoch != epoch_) {
    order_ = permutation(count_, derive_seed(seed_, {epoch}));
    epoch_ = epoch;
  }
  return order_[position % count_];
}

}  // namespace itn
