// Random numbers that are the same on every machine: each sequence is a function of its seed, and
// each seed can be derived from another and a place in a tree of choices, so that there is no state
// that would have to be kept.
#pragma once

#include <cstdint>
#include <initializer_list>

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

}  // namespace itn
