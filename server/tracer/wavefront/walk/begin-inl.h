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

#include "server/tracer/film/work_queue.h"
#include "server/tracer/wavefront/pixel_sequences-inl.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

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
  bool begin_path(Paths& paths, size_t slot) {
    if (next_ == count_ && !take_samples()) return false;
    const PathSample& sample = samples_[next_];
    const CameraRay& ray = camera_rays_[next_];
    paths.begin(slot);
    for_each_column(paths.weights(),
                    [&](FloatColumn& weight) { weight[slot] *= scene_.camera_weight; });
    paths.pixel[slot] = sample.pixel;
    paths.sample[slot] = sample.sample;
    paths.expected[slot] = sample.expected;
    paths.first_flight[slot] = film_points_[2][next_];
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
