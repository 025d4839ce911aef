// Random choices that are the same on every machine and after every restart: each is a function of
// a seed, so that there is no generator whose state would have to be kept.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <vector>

namespace itn {

// A seed for each branch of a tree of choices, e.g. derive_seed(seed, {step, index}).
uint64_t derive_seed(uint64_t seed, std::initializer_list<uint64_t> path);

// SplitMix64 (Steele et al., "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014).
class SplitMix {
 public:
  explicit SplitMix(uint64_t seed) : state_(seed) {}
  uint64_t next();
  double uniform();                // in [0, 1)
  uint64_t below(uint64_t count);  // in [0, count), unbiased; count >= 1

 private:
  uint64_t state_;
};

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
