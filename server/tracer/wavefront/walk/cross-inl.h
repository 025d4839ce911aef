// Crossings of a boundary at which lines stop (server/tracer/boundary/boundary.h).
#if defined(ITN_TRACER_WAVEFRONT_WALK_CROSS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_CROSS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_CROSS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_CROSS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/boundary/boundary.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The boundary sends a path on. Shadow rays end there: behind it, light is the walk's alone.
inline void cross(Wavefront& wave, size_t slot) {
  Paths& paths = wave.paths;
  const Crossings& crossings = wave.crossings;
  const bool inside = (paths.rays.interaction[slot] & Rays::kInside) != 0;
  const Sampler sampler(wave.request.seed, paths.pixel[slot], paths.sample[slot]);
  const BoundarySample next =
      tracer::sample(wave.scene.boundary,
                     {.point = paths.rays.position.at(slot),
                      .normal = crossings.normal.at(slot),
                      .direction = paths.rays.direction.at(slot),
                      .triangle = crossings.triangle[slot],
                      .leaving = inside},
                     sampler.uniforms(paths.vertex[slot], Sampler::kBoundary));
  if (++paths.crossings[slot] > kMaxConsecutiveCrossings) {
    paths.leaked[slot] = 1;
    return;
  }
  if (next.event == BoundarySample::Event::kAbsorbed) return;
  const bool passes = next.event == BoundarySample::Event::kTransmitted;
  paths.rays.interaction[slot] = inside != passes ? Rays::kInside : 0;
  paths.rays.direction.set(slot, next.direction);
  paths.delta_bounce[slot] = paths.alive[slot] = 1;
  for_each_column(paths.weights(), [&](FloatColumn& weight) { weight[slot] *= next.weight; });
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
