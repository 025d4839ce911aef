// The odds that a refracted shadow ray would have gone where a walk, or another shadow ray, goes
// (refracted_rays-inl.h).
#if defined(ITN_TRACER_WAVEFRONT_WALK_REFRACTION_ODDS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_REFRACTION_ODDS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_REFRACTION_ODDS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_REFRACTION_ODDS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/wavefront/walk/facet_search-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Sends rays from paths that leave the medium through a smooth boundary to find out whether a
// refracted one would have gone there (check_odds), and then, with which odds.
inline void send_odds(Wavefront& wavefront, size_t i, Mask leaving, Uints medium,
                      const Crossing& crossing) {
  Paths& paths = wavefront.paths;
  OddsRays& refracted = wavefront.odds_rays;
  const FloatTag d;
  const Floats zero = hn::Zero(d), walk_pdf = load(paths.scattered_pdf[0], i);
  Mask where = leaving & (walk_pdf > 0);
  if (hn::AllFalse(d, where)) return;
  const Lights& lights = wavefront.scene.lights;
  const Vectors up = set(Vec3f{0, 1, 0}), x = scattered_at(paths, i);
  const Floats index = index_of(wavefront.media, medium);
  const bool flat = wavefront.scene.obstacles.corner_normals.flat();
  const VectorColumn& normals =
      flat ? wavefront.crossings.normal : wavefront.crossings.smooth_normal;
  const Plane plane{if_then_else(where, load(normals, i), up), index};
  const Vectors inner = load(paths.rays.direction, i);
  const Aim along = aim_along(plane, inner);
  const auto [outer, reflected] = transmit_boundary(wavefront.media, medium, crossing);
  where &= along.possible;
  Vectors to_light = if_then_else(where, along.direction, up);
  Floats by_drawn = along.inner_by_outer, far = zero;
  Target target{to_light, hn::Zero(UintTag()), hn::FirstN(d, 0), {}};
  const Vectors y = load(paths.rays.position, i), to_boundary = y - x;
  if (lights.has_lamps()) {
    const Uints lamp = lamp_seen(lights, y, if_then_else(where, outer, up));
    const LampMiddle middle = seen_middle(lights, lamp, x);
    far = way_to_plane(middle, to_boundary, to_light);
    const Vectors to_point = to_boundary + to_light * far;
    const Mask to_lamp = not_zero(lamp);
    where = hn::AndNot(to_lamp & (far >= kInfinity), where);
    const Floats near = hn::Sqrt(dot(to_boundary, to_boundary));
    by_drawn = hn::IfThenElse(
        to_lamp, inner_by_straight(plane, middle, to_point, inner, to_light, near, far), by_drawn);
    target = {if_then_else(to_lamp, to_point, to_light), lamp, to_lamp, middle};
  }
  const Uints triangle =
      hn::IfThenElseZero(for_uints(where), load(wavefront.crossings.triangle, i));
  if (!flat) {
    const CurvedFacet facet =
        curved_facet(wavefront.scene.obstacles, hn::BitCast(IntTag(), triangle), x);
    by_drawn =
        inner_by_drawn(facet, bend_at(facet, index, to_boundary, target), index, target, far);
  }
  to_light = if_then_else(where, target.direction(), up);
  const Aim first = aim_at({normal_near(wavefront, x), index}, to_light);
  const Vectors search = if_then_else(first.possible, first.direction, to_light);
  const Floats pdf = drawn_pdf(lights, target.lamp, x, to_light) * by_drawn;
  where &= pdf < kMostDensity;
  const Floats arriving =
      (1 - reflected) * part_arriving(wavefront, medium, load(paths.rays.medium_length, i));
  const Mask asked = where & (pdf > 0);
  const Append append{asked, refracted.count};
  append_inside(append, x, search, longest_search(wavefront, medium), refracted.rays);
  append(slots_from(i), refracted.slot);
  append(pdf / (walk_pdf * arriving), refracted.odds);
  append(x, refracted.origin);
  append(target.place, refracted.target);
  append(target.lamp, refracted.lamp);
  append(triangle, refracted.facet);
  append(to_boundary, refracted.exit_place);
  refracted.count += hn::CountTrue(d, asked);
}

// Sends rays from paths at a nearly smooth boundary to find out how a refracted one would have gone
// there for a target (check_odds). `per` is what the odds are multiplied by, and `shadow_ray` the
// shadow ray that they are of.
inline void send_lobe_odds(Wavefront& wavefront, OddsRays& refracted, size_t i, Mask where,
                           Uints medium, const Target& target, Floats per, Uints shadow_ray) {
  const Floats arrival = per_arrival(wavefront, i, medium);
  where &= arrival > 0;
  if (hn::AllFalse(FloatTag(), where)) return;
  const Vectors x = scattered_at(wavefront.paths, i), outer = target.direction();
  const Aim aim = first_aim(wavefront, medium, x, outer);
  const Append append{where, refracted.count};
  append_inside(append, x, if_then_else(aim.possible, aim.direction, outer),
                longest_search(wavefront, medium), refracted.rays);
  append(slots_from(i), refracted.slot);
  append(arrival * per, refracted.odds);
  append(x, refracted.origin);
  append(target.place, refracted.target);
  append(target.lamp, refracted.lamp);
  append(load(wavefront.paths.rays.direction, i), refracted.exit_direction);
  append(shadow_ray, refracted.shadow_ray);
  refracted.count += hn::CountTrue(FloatTag(), where);
}

// Calls visit(column) for what shadow rays bring.
template <typename Visit>
inline void for_each_light_column(ShadowRays& rays, const Visit& visit) {
  visit(rays.light);
  for (FloatColumn& column : rays.per_radiance) visit(column);
}

// The odds of walks (send_odds), where a search finds the facet that they left by.
inline void check_facets(Wavefront& wavefront) {
  OddsRays& refracted = wavefront.odds_rays;
  FloatColumn& odds = wavefront.paths.odds[0];
  search_facets(
      wavefront, refracted,
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        const Floats zero = hn::Zero(FloatTag());
        Mask found;
        const FacetChoice choice =
            choose_facet(wavefront, refracted, i, medium, met, zero, load(refracted.facet, i),
                         load(refracted.exit_place, i), found);
        const Floats own = load(refracted.odds, i) / choice.count;
        hn::ScatterIndex(hn::IfThenElse(found, own, gather(odds.data(), slots)), FloatTag(),
                         odds.data(), slots);
        return met & (choice.count > 0);
      },
      [](size_t /*i*/, Ints /*slots*/, Uints /*medium*/, Mask /*met*/) {});
}

// The odds of what leaves through a nearly smooth boundary (send_lobe_odds): calls
// visit(i, slots, odds, where).
template <typename Visit>
inline void check_lobes(Wavefront& wavefront, OddsRays& refracted, const Visit& visit) {
  search_facets(
      wavefront, refracted,
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        const LobeSum sum =
            sum_lobes(wavefront, refracted, i, medium, met, load(refracted.exit_direction, i));
        const Mask solved = met & (sum.count > 0);
        visit(i, slots, load(refracted.odds, i) * (sum.pdf / sum.count), solved);
        return solved;
      },
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        const Aim aim = first_aim_of(wavefront, refracted, i, medium, met);
        const Floats pdf =
            lobe_pdf(wavefront, medium, aim.direction, load(refracted.exit_direction, i));
        visit(i, slots, load(refracted.odds, i) * pdf, met & aim.possible);
      });
}

inline void check_odds(Wavefront& wavefront) {
  if (!wavefront.searches_facets) return;
  if (wavefront.boundary_is_delta) return check_facets(wavefront);
  const FloatTag d;
  check_lobes(
      wavefront, wavefront.odds_rays, [&](size_t /*i*/, Ints slots, Floats odds, Mask where) {
        float* const of_paths = wavefront.paths.odds[0].data();
        hn::ScatterIndex(hn::IfThenElse(where, odds, gather(of_paths, slots)), d, of_paths, slots);
      });
  check_lobes(wavefront, wavefront.shadow_odds,
              [&](size_t i, Ints /*slots*/, Floats odds, Mask where) {
                const Ints rays = slots_in(wavefront.shadow_odds.shadow_ray, i, where);
                const Floats part = 1 / (1 + odds);
                for_each_light_column(wavefront.shadow_rays, [&](FloatColumn& light) {
                  hn::ScatterIndex(gather(light.data(), rays) * part, d, light.data(), rays);
                });
              });
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
