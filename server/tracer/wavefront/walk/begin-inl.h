// How paths begin: samples of the queue get a ray of the camera and a slot.
#if defined(ITN_TRACER_WAVEFRONT_WALK_BEGIN_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_BEGIN_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_BEGIN_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_BEGIN_INL_H_
#endif

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "common/low_discrepancy.h"
#include "server/tracer/film/plan.h"
#include "server/tracer/random/sampler.h"
#include "server/tracer/request/request.h"
#include "server/tracer/wavefront/walk/state-inl.h"

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

// Samples are taken many at a time, so that their first points are drawn in lanes, and wait here
// until a slot is free.
class PathSource {
 public:
  PathSource(const Scene::Compiled& scene, const RenderRequest& request, const Switches& switches,
             WorkQueue& queue)
      : scene_(scene),
        request_(request),
        switches_(switches),
        queue_(queue),
        sequences_(request.seed, request.estimates) {}

  // Puts the next path into a slot, with the camera's ray. False if there is none.
  bool begin_path(Wavefront& wavefront, size_t slot) {
    Paths& paths = wavefront.paths;
    if (next_ == count_ && !take_samples()) return false;
    const PathSample& sample = samples_[next_];
    const CameraRay& ray = camera_rays_[next_];
    wavefront.begin(slot);
    wavefront.for_each_weight([&](FloatColumn& weight) { weight[slot] *= scene_.camera_weight; });
    for (UintColumn& medium : paths.medium) {
      medium[slot] = static_cast<uint32_t>(scene_.camera_medium);
    }
    paths.pixel[slot] = sample.pixel;
    paths.sample[slot] = sample.sample;
    paths.expected[slot] = sample.expected;
    paths.first_flight[slot] = film_points_[2][next_];
    if (wavefront.collected.colours.asked()) {
      wavefront.collected.colours.choose(slot, paths.first_flight[slot]);
    }
    paths.rays.position.set(slot, ray.origin);
    paths.rays.direction.set(slot, ray.direction);
    paths.rays.interaction[slot] = scene_.camera_inside ? Rays::kInside : 0;
    ++next_;
    return true;
  }

 private:
  // Takes the next samples from the queue, and finds out with which rays their paths begin. False
  // if there are none.
  bool take_samples() {
    next_ = 0;
    count_ = queue_.take(samples_);
    const std::span<const PathSample> taken = std::span(samples_).first(count_);
    if (switches_.stratified) {
      sequences_.draw(taken, film_points_);
    } else {
      for (size_t i = 0; i < count_; ++i) {
        const Uniforms u =
            Sampler(request_.seed, taken[i].pixel, taken[i].sample).uniforms(0, Sampler::kFilm);
        for (size_t k = 0; k < 3; ++k) film_points_[k][i] = u[k];
      }
    }
    const auto width = static_cast<uint32_t>(scene_.film.width);
    for (size_t i = 0; i < count_; ++i) {
      const uint32_t pixel = taken[i].pixel;
      camera_rays_[i] = scene_.camera_ray(pixel % width + double{film_points_[0][i]},
                                          pixel / width + double{film_points_[1][i]});
    }
    return count_ > 0;
  }

  const Scene::Compiled& scene_;
  const RenderRequest& request_;
  const Switches& switches_;
  WorkQueue& queue_;
  // Paths that have not begun, with the random numbers of film position and first flight.
  PixelSequences sequences_;
  std::array<PathSample, PixelSequences::kMaxSamples> samples_;
  std::array<CameraRay, PixelSequences::kMaxSamples> camera_rays_;
  PixelSequences::Points film_points_;
  size_t count_ = 0, next_ = 0;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
