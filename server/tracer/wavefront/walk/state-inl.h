// What the stages of a walk share: what is rendered, and the paths under way.
#if defined(ITN_TRACER_WAVEFRONT_WALK_STATE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_STATE_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_STATE_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_STATE_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <numbers>
#include <vector>

#include "server/tracer/collected/collected-inl.h"
#include "server/tracer/collected/media-inl.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/geometry/lines/lines-inl.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/random/philox-inl.h"
#include "server/tracer/random/sampler.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/wavefront/walk/paths.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

struct Wavefront {
  Wavefront(const Scene::Compiled& compiled, const RenderRequest& asked,
            const RenderOptions& options, FilmWriter& to)
      : film(to),
        scene(compiled),
        request(asked),
        switches(options.switches),
        media(compiled, asked),
        shadow_ray_threshold(static_cast<float>(options.tuning.shadow_ray_roulette *
                                                compiled.lights.power() / (4 * std::numbers::pi))),
        stops_at_boundary(stops_lines(compiled.boundary)),
        boundary_is_delta(is_delta(compiled.boundary)),
        refracts_shadow_rays(refracts(compiled.boundary) &&
                             options.switches.refracted_shadow_rays &&
                             options.switches.techniques != Switches::Techniques::kPhaseOnly),
        searches_facets(refracts_shadow_rays && !compiled.obstacles.facets.by_triangle.empty()),
        mirrors_shadow_rays(boundary_is_delta && refracts_shadow_rays),
        boundary_derivatives{collected.scores.index_score().has_value(), asked.gradient_normals} {
    shadow_rays.per_radiance.resize(asked.gradient_light ? 1 : 0);
    shadow_rays.scores.resize(collected.scores.count());
    part_count = std::max(collected.colours.size(), collected.light_scales.lights().size());
    paths.medium.resize(media.several ? 1 : 0);
    paths.edge_weight.resize(boundary_derivatives.any() ? 1 : 0);
    paths.crossing_edge_weight.resize(paths.edge_weight.size());
    paths.rays.bounded = compiled.lights.has_lamps();
    shadow_rays.rays.bounded = compiled.lights.has_near();
    if (refracts_shadow_rays) {
      paths.scattered_at.resize(3);
      paths.scattered_pdf.resize(1);
      paths.odds.resize(1);
      for (RefractedRays* rays : {&refracted_rays, &aimed_again}) {
        rays->scores.resize(collected.scores.count());
      }
    }
  }

  // The medium that paths in slots i, i + 1 ..., or in any slots, are in, or whose boundary they
  // met last.
  HWY_INLINE Uints medium(size_t i) const {
    return media.several ? load(paths.medium[0], i) : hn::Zero(UintTag());
  }
  HWY_INLINE Uints medium_in(Ints of_paths) const {
    if (!media.several) return hn::Zero(UintTag());
    return gather(paths.medium[0], of_paths);
  }

  // All but the ray and the sample of a path.
  void begin(size_t slot) {
    paths.begin(slot);
    collected.begin(slot);
  }
  void move(size_t from, size_t to) {
    paths.move(from, to);
    collected.move(from, to);
  }
  // Calls visit(column) for all that a factor of the weight of paths multiplies.
  template <typename Visit>
  HWY_INLINE void for_each_weight(const Visit& visit) {
    for_each_column(paths.weights(), visit);
    collected.for_each_weight(visit);
  }

  // The mean radiance of the lights over all directions.
  float mean_radiance() const {
    return static_cast<float>(scene.lights.power() / (4 * std::numbers::pi));
  }

  FilmWriter& film;
  const Scene::Compiled& scene;
  const RenderRequest& request;
  const Switches& switches;
  const Media media;
  const float shadow_ray_threshold;  // of their roulette, as a radiance; 0: all are traced
  size_t part_count = 0;             // of light: see LightParts

  Paths paths;
  Collected collected{scene, request, film};
  size_t count = 0;  // of paths under way, in slots 0 .. count - 1
  ShadowRays shadow_rays;
  // Whether lines stop at the boundary, and then where those that were followed last did.
  const bool stops_at_boundary;
  const bool boundary_is_delta, refracts_shadow_rays;
  const bool searches_facets, mirrors_shadow_rays;  // if they are refracted
  const BoundaryDerivatives boundary_derivatives;
  RefractedRays refracted_rays, aimed_again;
  OddsRays odds_rays, shadow_odds;
  Crossings crossings;
  Crossings* at_boundary() { return stops_at_boundary ? &crossings : nullptr; }
};

// The optical depth through which a ray that carries this importance without the medium's dimming
// survives its roulette (send_shadow_rays), by a uniform number in (0, 1]; else 0 or less.
HWY_INLINE Floats depth_limit(const Wavefront& wavefront, Floats importance, Floats u) {
  const Floats limit = set(kMaxOpticalDepth);
  if (wavefront.shadow_ray_threshold <= 0) return limit;
  const Floats odds = importance / (u * wavefront.shadow_ray_threshold);
  const Mask any = importance > 0;
  return hn::IfThenElseZero(any, hn::Min(limit, log(odds)));
}

// Slots; where they are not `live` the spare one, where nothing counts.
HWY_INLINE Ints slots_where(Mask live, Uints slots) {
  const Uints spare = set(static_cast<uint32_t>(kSlots));
  return hn::BitCast(IntTag(), hn::IfThenElse(for_uints(live), slots, spare));
}
// A list's from number i on.
HWY_INLINE Ints slots_in(const UintColumn& list, size_t i, Mask live) {
  return slots_where(live, load(list, i));
}

// Adds rays that begin in the medium, and go at most so far in it, in mm.
HWY_INLINE void append_inside(const Append& append, Vectors position, Vectors direction,
                              Floats limit, Rays& rays) {
  append(position, rays.position);
  append(direction, rays.direction);
  append(set(Rays::kInside), rays.interaction);
  append(limit, rays.max_medium_length);
}

// Shadow rays as they are sent: see ShadowRays.
struct SentShadowRays {
  Vectors position, direction;
  Uints interaction, slot;
  Floats light;
  Uints source;  // of it: Lights::Light::source
  Floats importance;
  Floats per_radiance;  // for a gradient in a panorama
  Floats distance;      // where they are bounded
  Floats max_medium_length, length_before;
  Vectors normal_score = set(Vec3f{});
  Uints triangle = hn::Zero(UintTag());
};

// Adds them, where there are any; `score(s)` is a score of their whole path.
template <typename Score>
HWY_INLINE void add_shadow_rays(Wavefront& wavefront, Mask where, const SentShadowRays& shadow_rays,
                                const Score& score) {
  ShadowRays& columns = wavefront.shadow_rays;
  const Append append{where, columns.count};
  append(shadow_rays.position, columns.rays.position);
  append(shadow_rays.direction, columns.rays.direction);
  append(shadow_rays.interaction, columns.rays.interaction);
  append(shadow_rays.max_medium_length, columns.rays.max_medium_length);
  if (wavefront.refracts_shadow_rays) append(shadow_rays.length_before, columns.length_before);
  if (columns.rays.bounded) append(shadow_rays.distance, columns.rays.distance);
  append(shadow_rays.light, columns.light);
  if (wavefront.part_count > 0) append(shadow_rays.source, columns.source);
  append(shadow_rays.importance, columns.importance);
  if (wavefront.collected.map_gradient.asked())
    append(shadow_rays.per_radiance, columns.per_radiance[0]);
  if (wavefront.collected.normal_gradient) {
    append(shadow_rays.normal_score, columns.normal_score);
    append(shadow_rays.triangle, columns.triangle);
  }
  for (size_t s = 0; s < columns.scores.size(); ++s) append(score(s), columns.scores[s]);
  append(shadow_rays.slot, columns.slot);
  columns.count += hn::CountTrue(FloatTag(), where);
}

HWY_INLINE void mark_leaked(Paths& paths, Mask leaked, Ints slots) {
  if (hn::AllFalse(FloatTag(), leaked)) return;
  const Uints before = gather(paths.leaked, slots);
  hn::ScatterIndex(hn::IfThenElse(for_uints(leaked), set(uint32_t{1}), before), UintTag(),
                   paths.leaked.data(), slots);
}

// The numbers of the slots i, i + 1 ...
HWY_INLINE Uints slots_from(size_t i) {
  return hn::Iota(UintTag(), 0) + set(static_cast<uint32_t>(i));
}

// Some slots, of which few may be neighbours: what is done for them is done for full lanes.
class SlotList {
 public:
  // Adds those of i, i + 1 ... at which `where` is set.
  HWY_INLINE void add(size_t i, Mask where) {
    Append{where, count_}(slots_from(i), numbers_);
    count_ += hn::CountTrue(FloatTag(), where);
  }
  // Calls visit(slots, live), where `slots` that are not `live` are the spare one.
  template <typename Visit>
  HWY_INLINE void for_each(const Visit& visit) const {
    for (size_t i = 0; i < count_; i += lanes()) {
      const Mask live = hn::FirstN(FloatTag(), count_ - i);
      visit(slots_in(numbers_, i, live), live);
    }
  }

 private:
  UintColumn numbers_;
  size_t count_ = 0;
};

// The random numbers of vertices of the paths in slots i, i + 1 ...
HWY_INLINE Words random(const Wavefront& wavefront, size_t i, Uints vertex,
                        Sampler::Purpose purpose) {
  return philox(vertex, set(uint32_t{purpose}), load(wavefront.paths.sample, i),
                load(wavefront.paths.pixel, i), wavefront.request.seed);
}

// Multiplies weights by a factor that no derivative is asked for in.
HWY_INLINE void multiply_weights(Wavefront& wavefront, size_t i, Floats factor) {
  wavefront.for_each_weight(
      [&](FloatColumn& weight) { store(load(weight, i) * factor, weight, i); });
}

// What light at the end of a path counts; of colours the mean.
HWY_INLINE Floats mean_weight(const Wavefront& wavefront, size_t i) {
  const Colours& colours = wavefront.collected.colours;
  return colours.asked() ? colours.mean_weight(i) : load(wavefront.paths.weight, i);
}

// The importance of a path, for roulette.
HWY_INLINE Floats path_importance(const Wavefront& wavefront, size_t i) {
  const Paths& paths = wavefront.paths;
  Floats importance = mean_weight(wavefront, i);
  importance = wavefront.collected.importance(importance, i);
  for (const FloatColumn& edge : paths.edge_weight) importance = hn::Max(importance, load(edge, i));
  return importance;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
