// Random choices that are the same on every machine and after every restart: each is a function of
// a seed, so that there is no generator whose state would have to be kept.
#pragma once

#include <cstdint>
#include <vector>

#include "common/random.h"

namespace itn {

// A random order of 0 .. count-1.
std::vector<uint32_t> permutation(uint32_t count, uint64_t seed);

// The items of each training step: epoch after epoch, each in an order of its own, cut into batches
// without regard to where an epoch ends.
class EpochSampler {
 public:
  // count >= 1.
  EpochSampler(uint32_t count, uint64_t seed) : count_(count), seed_(seed) {}

  std::vector<uint32_t> batch(uint64_t step, uint32_t size);

 private:
  uint32_t item(uint64_t position);

  uint32_t count_;
  uint64_t seed_;
  uint64_t epoch_ = UINT64_MAX;  // that `order_` is of
  std::vector<uint32_t> order_;
};

}  // namespace itn
