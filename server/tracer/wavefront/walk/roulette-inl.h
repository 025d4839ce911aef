// Russian roulette of the walks.
#if defined(ITN_TRACER_WAVEFRONT_WALK_ROULETTE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_ROULETTE_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_ROULETTE_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_ROULETTE_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/tracer/geometry/depth_grid-inl.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// How the roulette of walks judges them (russian_roulette). The more there is to gain, the
// shorter the paths that are stopped: derivatives depend on longer paths than the image, and thin
// objects on shorter ones than thick. Measured best, in variance times time, on a cube, a thin leaf
// and a figure.
struct WalkRoulette {
  float per_threshold;  // 1 / that below which paths play
  // By medium, of the light with depth, in a third of a cell of the depths.
  std::vector<float> attenuations;

  WalkRoulette(const Scene::Compiled& scene, const RenderRequest& request, const Tuning& tuning) {
    const Vec3f size = scene.obstacles.bounds.max - scene.obstacles.bounds.min;
    const bool derivatives = asks_for_medium(request);
    const bool thin = request.material.sigma_t * double{std::max({size.x, size.y, size.z})} < 50;
    const double threshold = tuning.walk_roulette >= 0 ? tuning.walk_roulette
                             : !derivatives            ? 0.35
                             : thin                    ? 0.2
                                                       : 0.25;
    per_threshold = static_cast<float>(1 / std::max(threshold, 1e-20));
    const double part = tuning.depth_roulette >= 0 ? tuning.depth_roulette
                        : !derivatives             ? 0.8
                                                   : 0.5;
    // In media so thick that light falls off within a cell, depths are too coarse to be believed.
    constexpr double kMaxByCell = 0.7;
    const auto add = [&](double sigma_t, double albedo, double g) {
      // See remaining_light.
      const double kappa = sigma_t * std::min(1.0, std::sqrt(3 * (1 - albedo) * (1 - albedo * g)));
      const double by_cell = part * kappa * scene.obstacles.depth_grid.cells.edge;
      attenuations.push_back(static_cast<float>(std::min(by_cell, kMaxByCell) / 3));
    };
    add(request.material.sigma_t, request.material.albedo, mean_cosine(request));
    for (const auto& other : scene.other_media) {
      add(other.material.sigma_t, other.material.albedo, other.material.g);
    }
  }
};

// Survivors of the roulette by depth gain at most exp(4) in weight: more would be fireflies.
constexpr float kMinExponent = -4;

// How much light is left where the path is, of that below the boundary: it falls off as
// exp(-kappa z) with the depth z, by diffusion theory with
//   kappa = sqrt(3 (1 - albedo) (1 - albedo g)) sigma_t,
// which is too steep where it exceeds sigma_t. As this knows nothing of where the light comes
// from, nor of paths that bring it back, only a part of it is believed.
HWY_INLINE Floats remaining_light(const Wavefront& wavefront, const WalkRoulette& roulette,
                                  size_t i) {
  const Paths& paths = wavefront.paths;
  const Mask inside = is_inside(load(paths.rays.interaction, i));
  const DepthGrid& depth_grid = wavefront.scene.obstacles.depth_grid;
  const Ints cells = cells_at(depth_grid.cells, load(paths.rays.position, i));
  const Floats quantized = hn::IfThenElseZero(inside, quantized_depth(depth_grid, cells));
  const Floats attenuation = by_medium(wavefront.media, wavefront.medium(i), [&](const Medium& of) {
    return set(roulette.attenuations[of.number]);
  });
  const Floats exponent = -(quantized * attenuation);
  return exp(hn::Max(exponent, set(kMinExponent)));
}

// The survival that path tracers usually play by.
inline Floats throughput_survival(const Wavefront& wavefront, size_t i) {
  const Paths& paths = wavefront.paths;
  const Mask begun =
      hn::RebindMask(FloatTag(), hn::BitCast(IntTag(), load(paths.vertex, i)) >
                                     hn::Set(IntTag(), int{ThroughputRoulette::kFirstVertex} - 1));
  Floats importance = wavefront.collected.throughput(load(paths.weight, i), i);
  for (const FloatColumn& edge : paths.edge_weight) importance = hn::Max(importance, load(edge, i));
  const Mask crosses =
      hn::RebindMask(FloatTag(), hn::Ne(load(paths.crossings, i), hn::Zero(UintTag())));
  const Floats most = hn::IfThenElse(crosses, set(1.0F), set(ThroughputRoulette::kMaxSurvival));
  return hn::IfThenElse(begun, hn::Min(most, importance), set(1.0F));
}

// What the boundary makes of the weights.
HWY_INLINE void apply_crossing(Wavefront& wavefront, size_t i) {
  Paths& paths = wavefront.paths;
  const Floats weight = load(paths.weight, i);
  Floats colour_weights[kColours.size()];
  Colours& colours = wavefront.collected.colours;
  colours.for_each_edge([&](size_t c, const FloatColumn& of_colour, const FloatColumn& /*edge*/) {
    colour_weights[c] = load(of_colour, i);
  });
  multiply_weights(wavefront, i, load(paths.crossing_weight, i));
  if (paths.edge_weight.empty()) return;
  const Floats by = load(paths.crossing_edge_weight[0], i);
  const auto add_to = [&](FloatColumn& edge, Floats before) {
    store(mul_add(before, by, load(edge, i)), edge, i);
  };
  add_to(paths.edge_weight[0], weight);
  colours.for_each_edge([&](size_t c, const FloatColumn& /*weight*/, FloatColumn& edge) {
    add_to(edge, colour_weights[c]);
  });
}

// Russian roulette: a path that is worth little ends, or goes on for those that ended.
inline void russian_roulette(Wavefront& wavefront, const WalkRoulette& roulette) {
  Paths& paths = wavefront.paths;
  const Floats one = set(1.0F);
  for (size_t i = 0; i < wavefront.count; i += lanes()) {
    if (wavefront.stops_at_boundary) apply_crossing(wavefront, i);
    const Floats probability =
        wavefront.switches.throughput_roulette
            ? throughput_survival(wavefront, i)
            : hn::Min(one, path_importance(wavefront, i) * remaining_light(wavefront, roulette, i) *
                               roulette.per_threshold);
    const Mask survives = (load(paths.u3, i) < probability) & !not_zero(load(paths.leaked, i));
    const Floats factor = 1 / hn::Max(probability, set(1e-30F));
    multiply_weights(wavefront, i, factor);
    store(hn::IfThenElseZero(for_uints(survives), load(paths.alive, i)), paths.alive, i);
    store(load(paths.vertex, i) + set(uint32_t{1}), paths.vertex, i);
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
