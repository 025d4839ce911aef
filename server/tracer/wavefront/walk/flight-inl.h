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
HWY_INLINE Mask ends_at_boundary(const Wavefront& wave, size_t i) {
  if (!wave.stops_at_boundary) return hn::FirstN(FloatTag(), 0);
  return is_inside(load(wave.paths.rays.interaction, i));
}

// Free flights of all paths. As flights are memoryless, one path length serves for all the parts
// of the line that lie inside the medium.
inline void sample_flights(Wavefront& wave) {
  Paths& paths = wave.paths;
  const Floats zero = hn::Zero(FloatTag());
  // A line that stops at the boundary flies nowhere in the medium before.
  const uint32_t first = wave.stops_at_boundary && !wave.scene.camera_inside ? 2 : 1;
  for (size_t i = 0; i < wave.count; i += lanes()) {
    const Uints vertex = load(paths.vertex, i);
    const Words words = random(wave, i, vertex, Sampler::kWalk);
    const Floats u0 =
        hn::IfThenElse(equals(vertex, first), load(paths.first_flight, i), uniform(words.w[0]));
    const Floats depth = zero - log(1 - u0);
    store(wave.colours.empty() ? depth * free_path_of(wave.media, wave.medium(i))
                               : depth / load(paths.flight_sigma_t[0], i),
          paths.rays.max_medium_length, i);
    store(uniform(words.w[1]), paths.u1, i);
    store(uniform(words.w[2]), paths.u2, i);
    store(uniform(words.w[3]), paths.u3, i);
    if (paths.rays.bounded) {
      const Vectors from = load(paths.rays.position, i);
      store(from, paths.flight_from, i);
      const Floats to_lamp = reach(wave.scene.lights, from, load(paths.rays.direction, i));
      store(hn::IfThenElse(ends_at_boundary(wave, i), set(kInfinity), to_lamp), paths.rays.distance,
            i);
    }
  }
  follow_lines(wave.scene.obstacles, paths.rays, wave.count, Report::kEnds, wave.at_boundary());
}

// What flights add to the likelihoods of colours, and to their scores.
//
// The density of a path is, in each colour, a product of the same factors, but for its flights:
// with n scatterings and the length L in the medium, sigma_t^n exp(-sigma_t L). Of all paths, a
// third flies by each. By the balance heuristic, light that arrives along a path counts as if it
// had been drawn with the mean of the three densities, whichever it flew by: W times the density in
// the colour over that mean, the likelihood, which is 3 at most.
//
// Wilkie, Nawaz, Droske, Weidlich, Hanika, "Hero wavelength spectral sampling", EGSR 2014.
HWY_INLINE void update_likelihoods(Wavefront& wave, size_t i, Mask scattered) {
  Paths& paths = wave.paths;
  const Floats length = load(paths.rays.medium_length, i);
  Floats sum = hn::Zero(FloatTag());
  for (size_t c = 0; c < wave.colours.size(); ++c) {
    // Over what it is at the least sigma_t, which is the material's: exp does not overflow.
    const float sigma_t = wave.colours[c].sigma_t;
    const Floats flown = exp(length * (wave.sigma_t - sigma_t));
    const Floats ended = hn::IfThenElse(scattered, set(sigma_t / wave.sigma_t), set(1.0F));
    const Floats likelihood = load(paths.likelihood[c], i) * (flown * ended);
    store(likelihood, paths.likelihood[c], i);
    sum += likelihood;
    if (!wave.medium_derivatives) continue;
    const Floats score = hn::IfThenElseZero(scattered, set(1 / sigma_t)) - length;
    store(load(paths.colour_score[c], i) + score, paths.colour_score[c], i);
  }
  const Floats by = static_cast<float>(wave.colours.size()) / sum;
  for (FloatColumn& likelihood : paths.likelihood) {
    store(load(likelihood, i) * by, likelihood, i);
  }
}

// What flights add to scores and counts.
HWY_INLINE void update_scores(Wavefront& wave, size_t i, Mask scattered) {
  Paths& paths = wave.paths;
  wave.collected.on_flight({i, scattered, load(paths.rays.medium_length, i), wave.media,
                            wave.medium(i), load(paths.weight, i)});
  if (!wave.colours.empty()) update_likelihoods(wave, i, scattered);
  const Uints entered =
      hn::ShiftRight<Rays::kEnteredBit>(load(paths.rays.outcome, i)) & set(uint32_t{1});
  store(load(paths.steps, i) + entered, paths.steps, i);
  const auto first = for_uints(equals(load(paths.vertex, i), 1));
  store(hn::IfThenElse(first, entered, load(paths.hit, i)), paths.hit, i);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
