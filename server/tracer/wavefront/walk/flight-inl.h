// Free flights: how far paths go before they scatter.
#if defined(ITN_TRACER_WAVEFRONT_WALK_FLIGHT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_FLIGHT_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_FLIGHT_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_FLIGHT_INL_H_
#endif

#include <cstddef>

#include "server/tracer/geometry/lines/lines-inl.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Whether lines come to the boundary before any lamp, as these are outside.
HWY_INLINE Mask ends_at_boundary(const Wavefront& wavefront, size_t i) {
  if (!wavefront.stops_at_boundary) return hn::FirstN(FloatTag(), 0);
  return is_inside(load(wavefront.paths.rays.interaction, i));
}

// Free flights of all paths. As flights are memoryless, one path length serves for all the parts
// of the line that lie inside the medium.
inline void sample_flights(Wavefront& wavefront) {
  Paths& paths = wavefront.paths;
  const Floats zero = hn::Zero(FloatTag());
  // A line that stops at the boundary flies nowhere in the medium before.
  const uint32_t first = wavefront.stops_at_boundary && !wavefront.scene.camera_inside ? 2 : 1;
  for (size_t i = 0; i < wavefront.count; i += lanes()) {
    const Uints vertex = load(paths.vertex, i);
    const Words words = random(wavefront, i, vertex, Sampler::kWalk);
    const Floats u0 =
        hn::IfThenElse(equals(vertex, first), load(paths.first_flight, i), uniform(words.w[0]));
    const Floats depth = zero - log(1 - u0);
    const Colours& colours = wavefront.collected.colours;
    store(colours.asked() ? depth / colours.flight_sigma_t(i)
                          : depth * free_path_of(wavefront.media, wavefront.medium(i)),
          paths.rays.max_medium_length, i);
    store(uniform(words.w[1]), paths.u1, i);
    store(uniform(words.w[2]), paths.u2, i);
    store(uniform(words.w[3]), paths.u3, i);
    if (paths.rays.bounded) {
      const Vectors from = load(paths.rays.position, i);
      store(from, paths.flight_from, i);
      const Floats to_lamp = reach(wavefront.scene.lights, from, load(paths.rays.direction, i));
      store(hn::IfThenElse(ends_at_boundary(wavefront, i), set(kInfinity), to_lamp),
            paths.rays.distance, i);
    }
  }
  follow_lines(wavefront.scene.obstacles, paths.rays, wavefront.count, Report::kEnds,
               wavefront.at_boundary());
}

// What flights add to scores and counts.
HWY_INLINE void update_scores(Wavefront& wavefront, size_t i, Mask scattered) {
  Paths& paths = wavefront.paths;
  wavefront.collected.on_flight({i, scattered, load(paths.rays.medium_length, i), wavefront.media,
                                 wavefront.medium(i), load(paths.weight, i)});
  const Uints entered =
      hn::ShiftRight<Rays::kEnteredBit>(load(paths.rays.outcome, i)) & set(uint32_t{1});
  store(load(paths.steps, i) + entered, paths.steps, i);
  const auto first = for_uints(equals(load(paths.vertex, i), 1));
  store(hn::IfThenElse(first, entered, load(paths.hit, i)), paths.hit, i);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
