#include "common/random.h"

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
  while (value < rejected) value = next();
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

}  // namespace itn
