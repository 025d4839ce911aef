#include "client/dataset/sampler.h"

#include <numeric>
#include <utility>

namespace itn {

uint64_t SplitMix::next() {
  state_ += 0x9e3779b97f4a7c15;
  uint64_t z = state_;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  return z ^ (z >> 31);
}

double SplitMix::uniform() {
  return static_cast<double>(next() >> 11) * 0x1p-53;
}

uint64_t SplitMix::below(uint64_t count) {
  // Rejects the incomplete last stretch of the 64-bit range.
  const uint64_t rejected = -count % count;  // 2^64 mod count
  uint64_t value = next();
  while (value < rejected) {
    value = next();
  }
  return value % count;
}

uint64_t derive_seed(uint64_t seed, std::initializer_list<uint64_t> path) {
  uint64_t state = SplitMix(seed).next();
  for (const uint64_t branch : path) {
    // The complement keeps seed and branch from changing places.
    state = SplitMix(state ^ SplitMix(~branch).next()).next();
  }
  return state;
}

std::vector<uint32_t> permutation(uint32_t count, uint64_t seed) {
  std::vector<uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0U);
  SplitMix random(seed);
  // Fisher-Yates.
  for (uint32_t i = count; i > 1; --i) {
    std::swap(order[i - 1], order[random.below(i)]);
  }
  return order;
}

std::vector<uint32_t> EpochSampler::batch(uint64_t step, uint32_t size) {
  std::vector<uint32_t> items(size);
  for (uint32_t i = 0; i < size; ++i) {
    items[i] = item(step * size + i);
  }
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
