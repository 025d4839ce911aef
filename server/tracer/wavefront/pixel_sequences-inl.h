// The low-discrepancy points that samples of pixels begin with.
#if defined(ITN_TRACER_WAVEFRONT_PIXEL_SEQUENCES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_PIXEL_SEQUENCES_INL_H_
#undef ITN_TRACER_WAVEFRONT_PIXEL_SEQUENCES_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_PIXEL_SEQUENCES_INL_H_
#endif

#include <hwy/highway.h>

#include <array>
#include <cstdint>
#include <span>

#include "common/low_discrepancy.h"
#include "server/tracer/film/work_queue.h"
#include "server/tracer/random/sampler.h"
#include "server/tracer/request/request.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The points that samples of pixels begin with: x and y on the film, and the random number of the
// first flight. The samples of an estimate share a sequence; estimates, pixels and seeds have
// sequences of their own.
class PixelSequences {
 public:
  static constexpr size_t kMaxSamples = 128;                     // samples at a time
  using Points = std::array<std::array<float, kMaxSamples>, 3>;  // by coordinate

  PixelSequences(uint64_t seed, uint32_t estimates) : seed_(seed), estimates_(estimates) {}

  void draw(std::span<const PathSample> samples, Points& points) {
    std::array<std::array<uint32_t, 3>, kMaxSamples> exact;
    std::array<std::array<uint32_t, kMaxSamples>, 3> scrambles;
    for (size_t i = 0; i < samples.size(); ++i) {
      const Sequence& sequence = sequence_of(samples[i]);
      exact[i] = sobol_point(samples[i].sample / estimates_);
      for (size_t k = 0; k < 3; ++k) scrambles[k][i] = sequence.scrambles[k];
    }
    for (size_t k = 0; k < 3; ++k) {
      for (size_t i = 0; i < samples.size(); ++i) {
        points[k][i] = scrambled_coordinate(exact[i][k], scrambles[k][i]);
      }
    }
  }

 private:
  // The last one of each estimate: samples of a pixel come one after the other.
  struct Sequence {
    uint32_t pixel = ~0U;
    std::array<uint32_t, 3> scrambles{};
  };

  const Sequence& sequence_of(const PathSample& sample) {
    const uint32_t estimate = sample.sample % estimates_;
    Sequence& sequence = sequences_[estimate];
    if (sequence.pixel != sample.pixel) {
      const std::array<uint32_t, 2> seed{static_cast<uint32_t>(seed_),
                                         static_cast<uint32_t>(seed_ >> 32)};
      const std::array<uint32_t, 4> key = tracer::philox(
          std::array<uint32_t, 4>{estimate, Sampler::kSequence, 0, sample.pixel}, seed);
      sequence = {sample.pixel, {key[0], key[1], key[2]}};
    }
    return sequence;
  }

  uint64_t seed_;
  uint32_t estimates_;
  std::array<Sequence, kMaxEstimates> sequences_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
