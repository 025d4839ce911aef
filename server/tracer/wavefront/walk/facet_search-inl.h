// Searches for the facets of the boundary that refract light to where rays begin
// (refracted_rays-inl.h).
#if defined(ITN_TRACER_WAVEFRONT_WALK_FACET_SEARCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_FACET_SEARCH_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_FACET_SEARCH_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_FACET_SEARCH_INL_H_
#endif

#include <cstddef>
#include <vector>

#include "server/tracer/wavefront/walk/refraction-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Calls visit(number, place, live) for the facets around the ones that rays have met, one of each.
template <typename SentRays, typename Visit>
HWY_INLINE void for_each_facet(const Wavefront& wavefront, const SentRays& refracted, size_t i,
                               Uints medium, Mask met, const Visit& visit) {
  const FloatTag d;
  const IntTag di;
  const Obstacles& obstacles = wavefront.scene.obstacles;
  const Facets& facets = obstacles.facets;
  const auto int_gather = [&](const std::vector<uint32_t>& from, Ints at) {
    return hn::GatherIndex(di, reinterpret_cast<const int32_t*>(from.data()), at);
  };
  const auto int_mask = [&](Mask mask) { return hn::RebindMask(di, mask); };
  const Ints triangle =
      hn::IfThenElseZero(int_mask(met), hn::BitCast(di, load(wavefront.crossings.triangle, i)));
  const Ints begin = int_gather(facets.first, triangle);
  const Ints end = int_gather(facets.first, triangle + hn::Set(di, 1));
  const Vectors x = load(refracted.origin, i);
  const Target target = target_of(wavefront, refracted, i);
  const Floats index = index_of(wavefront.media, medium);
  for (Ints at = begin;; at = at + hn::Set(di, 1)) {
    const Mask live = met & hn::RebindMask(d, at < end);
    if (hn::AllFalse(d, live)) return;
    const Ints number = int_gather(facets.around, hn::IfThenElse(int_mask(live), at, begin));
    visit(number, place_on(obstacles, number, index, x, target), live);
  }
}

// The facets that refract the light to where the rays begin: how many there are, and one of them,
// which u chooses, and where on it.
struct FacetChoice {
  Floats count;
  Ints facet;
  Vectors to;
};
// `known`: one that does, at `place_of_known` from there, if it is among them; `found`: whether it
// is.
template <typename SentRays>
HWY_INLINE FacetChoice choose_facet(const Wavefront& wavefront, const SentRays& refracted, size_t i,
                                    Uints medium, Mask met, Floats u, Uints known,
                                    Vectors place_of_known, Mask& found) {
  constexpr float kSame = 1e-3F;
  const FloatTag d;
  const IntTag di;
  const Floats zero = hn::Zero(d), one = set(1.0F);
  const bool flat = wavefront.scene.obstacles.corner_normals.flat();
  FacetChoice choice{zero, hn::Zero(di), set(Vec3f{0, 1, 0})};
  found = hn::FirstN(d, 0);
  for_each_facet(
      wavefront, refracted, i, medium, met, [&](Ints number, const Place& place, Mask live) {
        const Mask is_number = live & hn::RebindMask(d, hn::Eq(number, hn::BitCast(di, known)));
        Mask is_known = is_number, refracts = live & place.possible;
        if (flat) {
          refracts = is_known | refracts;
        } else {
          const Vectors beside = place.to - place_of_known;
          const Floats most = kSame * kSame * dot(place.to, place.to);
          is_known = is_number & refracts & (dot(beside, beside) < most);
        }
        found |= is_known;
        choice.count += hn::IfThenElseZero(refracts, one);
        // One in n is what u says of the n-th, and what is left of u says which of those before.
        const Floats part = 1 / choice.count;
        const Mask taken = refracts & (u < part);
        choice.facet = hn::IfThenElse(hn::RebindMask(di, taken), number, choice.facet);
        choice.to = if_then_else(taken, place.to, choice.to);
        const Floats other = hn::Min((u - part) / (1 - part), set(0x1.fffffep-1F));
        u = hn::IfThenElse(taken, u * choice.count, hn::IfThenElse(refracts, other, u));
      });
  return choice;
}

// The facets again, behind which the boundary is rough: how many there are, and the sum of the
// densities at `direction` of the lobes around where they aim.
struct LobeSum {
  Floats count, pdf;
};
template <typename SentRays>
HWY_INLINE LobeSum sum_lobes(const Wavefront& wavefront, const SentRays& refracted, size_t i,
                             Uints medium, Mask met, Vectors direction) {
  const Floats zero = hn::Zero(FloatTag());
  LobeSum sum{zero, zero};
  for_each_facet(wavefront, refracted, i, medium, met,
                 [&](Ints /*number*/, const Place& place, Mask live) {
                   const Mask refracts = live & place.possible;
                   const Floats pdf = lobe_pdf(wavefront, medium, normalize(place.to), direction);
                   sum.count += hn::IfThenElseZero(refracts, set(1.0F));
                   sum.pdf += hn::IfThenElseZero(refracts, pdf);
                 });
  return sum;
}

// Copies how light was drawn, of rays to a rough boundary.
template <typename Copy>
inline void for_each_light_column(const RefractedRays& from, RefractedRays& to, const Copy& copy) {
  copy(from.radiance, to.radiance);
  copy(from.choice, to.choice);
  copy(from.u0, to.u0);
  copy(from.u1, to.u1);
  copy(from.source, to.source);
}
// Moves rays that search on to the front of their list, behind those that are there already.
template <typename SentRays>
inline void keep_searching(Wavefront& wavefront, SentRays& refracted, size_t i, Mask where,
                           Vectors direction, size_t& kept) {
  if (hn::AllFalse(FloatTag(), where)) return;
  const Append append{where, kept};
  const auto keep = [&](auto& column) { append(load(column, i), column); };
  if constexpr (requires { refracted.limit; }) {
    for (auto* column : {&refracted.limit, &refracted.importance, &refracted.light_pdf})
      keep(*column);
    keep(refracted.before);
    for (FloatColumn& score : refracted.scores) keep(score);
    if (!wavefront.boundary_is_delta) {
      for_each_light_column(refracted, refracted,
                            [&](const auto& from, auto& to) { append(load(from, i), to); });
    }
  } else {
    keep(refracted.odds);
    keep(wavefront.boundary_is_delta ? refracted.exit_place : refracted.exit_direction);
    keep(wavefront.boundary_is_delta ? refracted.facet : refracted.shadow_ray);
  }
  append_inside(append, load(refracted.origin, i), direction,
                load(refracted.rays.max_medium_length, i), refracted.rays);
  for (VectorColumn* column : {&refracted.origin, &refracted.target}) keep(*column);
  for (UintColumn* column : {&refracted.slot, &refracted.lamp}) keep(*column);
  kept += hn::CountTrue(FloatTag(), where);
}

// Follows rays inside to the boundary, and calls visit(i, slots, met): of which paths they are, and
// which of them meet it.
template <typename SentRays, typename Visit>
inline void follow_to_boundary(Wavefront& wavefront, SentRays& refracted, const Visit& visit) {
  const FloatTag d;
  follow_lines(wavefront.scene.obstacles, refracted.rays, refracted.count, Report::kEnds,
               &wavefront.crossings);
  for (size_t i = 0; i < refracted.count; i += lanes()) {
    const Mask live = hn::FirstN(d, refracted.count - i);
    const Uints end = load(refracted.rays.outcome, i) & set(Rays::kEndMask);
    const Ints slots = slots_in(refracted.slot, i, live);
    mark_leaked(wavefront.paths, live & equals(end, Rays::kLeaked), slots);
    visit(i, slots, live & equals(end, Rays::kCrossing));
  }
}

// Searches for facets: calls solve(i, slots, medium, met), which returns where there are some, for
// rays that have met the boundary. The others are aimed by the plane of what they have met, once
// more; where that is in vain, it calls give_up(i, slots, medium, met).
template <typename SentRays, typename Solve, typename GiveUp>
inline void search_facets(Wavefront& wavefront, SentRays& refracted, const Solve& solve,
                          const GiveUp& give_up) {
  constexpr int kSearches = 2;
  for (int search = 1; refracted.count > 0; ++search) {
    size_t kept = 0;
    follow_to_boundary(wavefront, refracted, [&](size_t i, Ints slots, Mask met) {
      const Uints medium = wavefront.medium_in(slots);
      const Mask left = hn::AndNot(solve(i, slots, medium, met), met);
      if (hn::AllFalse(FloatTag(), left)) return;
      const Vectors normal =
          if_then_else(left, load(wavefront.crossings.normal, i), set(Vec3f{0, 1, 0}));
      const Aim next = aim_at({normal, index_of(wavefront.media, medium)},
                              target_of(wavefront, refracted, i).direction());
      const Mask goes_on = search < kSearches ? left & next.possible : hn::FirstN(FloatTag(), 0);
      give_up(i, slots, medium, hn::AndNot(goes_on, left));
      keep_searching(wavefront, refracted, i, goes_on, next.direction, kept);
    });
    refracted.count = kept;
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
