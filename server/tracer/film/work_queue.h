// Where threads get the samples to trace from. Internal to the tracer.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <span>

#include "server/tracer/film/plan.h"

namespace itn::tracer {

// A path to be traced.
struct PathSample {
  uint32_t pixel = 0;
  uint32_t sample = 0;
  float expected = 0;  // radiance, which multiplies the derivatives' control variates
};

// Hands out the samples of a plan, in its order. Thread-safe.
class WorkQueue {
 public:
  explicit WorkQueue(const Plan& plan) : plan_(plan) {}

  // Fills some of `samples`, from the front, and returns how many; 0: there are no more.
  size_t take(std::span<PathSample> samples) {
    const uint64_t first = next_.fetch_add(samples.size(), std::memory_order_relaxed);
    if (first >= plan_.paths) return 0;
    const auto count = static_cast<size_t>(std::min<uint64_t>(samples.size(), plan_.paths - first));
    const auto begins_after = [](uint64_t path, const PlannedPixel& p) {
      return path < p.first_path;
    };
    auto at = std::upper_bound(plan_.pixels.begin(), plan_.pixels.end(), first, begins_after) - 1;
    for (size_t i = 0; i < count; ++i) {
      while (first + i >= at->first_path + at->sample_count) ++at;
      samples[i] = {at->pixel, static_cast<uint32_t>(first + i - at->first_path), at->expected};
    }
    return count;
  }

 private:
  const Plan& plan_;
  std::atomic<uint64_t> next_ = 0;
};

}  // namespace itn::tracer
