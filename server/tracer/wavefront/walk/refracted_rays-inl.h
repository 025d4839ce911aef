// Refracted shadow rays: next-event estimation through the boundary.
#if defined(ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/wavefront/walk/facet_search-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Multiple importance sampling of light that leaves the medium through a boundary that refracts. A
// path scatters at x, flies in direction w to the point y of the boundary, and leaves y towards a
// light in direction l. p is the phase function, and T the transmittance from x to y. The boundary
// draws l with density b, and the lights draw l with density s:
//
//   p(w) T b(l)   the boundary draws l at y, and the path meets the light by chance
//   p(w) T s(l)   a light is drawn at y, and a shadow ray is sent to it from y
//   q(w) s(l)     a light is drawn at x, and a ray is sent to a y that refracts it to the light
//
// The balance heuristic weighs all three. The second is noisy under small lights, as few directions
// w are refracted towards them; the third draws those directions. The odds of a refracted shadow
// ray are its density over that of the walk, q / (p T).
//
// q is a Henyey-Greenstein lobe that is as wide as the boundary is rough. Its axis is the direction
// in which a smooth plane with the normal of the boundary nearby (CellNormals) would refract the
// light to x. Where the boundary is curved or far away, this axis is a poor guess, and the first
// two techniques find the light. Behind a nearly smooth boundary (is_nearly_smooth) these two
// hardly ever find it; there, a search of facets gives the axis.
//
// Behind a smooth boundary, w determines l. The walk finds the light with density p(w) T (1 - R),
// where R is the reflectance of the boundary. A refracted shadow ray is aimed in two steps:
//
//   1. It is aimed by the normal near x, or straight at the light if that normal faces away from
//      it. It meets a facet, a triangle of the boundary (Facets).
//   2. This facet and its neighbours are tested, each by its plane or by the normals that are
//      interpolated over it. n of them refract the light to x. The ray is aimed at one of these,
//      drawn at random, and counts only if it meets that one. If n is 0, a ray that is aimed by the
//      plane of the first facet finds another facet, and step 2 is repeated once from there.
//
// So q(w) = s(l') dl'/dw / n, where l' is the direction into which the facet that w meets refracts
// w. q(w) is 0 if a search for l' does not find that facet; so each walk that leaves the medium
// needs a search, too.
//
// Behind a nearly smooth boundary, the same search finds n ways of the light to x, and q is the
// mean of the lobes around them; if n is 0, q is the lobe from above. Walks that leave the medium,
// and shadow rays that are sent from y, need a search, too, as q is evaluated for them.
//
// A lamp is a light that is near. The random numbers that draw it give one direction l at x and
// another at y: q is evaluated for the one at x, and s for the one at y. What lamps hide at x may
// be seen from y, so a ray is always sent, unless a light without a size (a delta) sends nothing to
// x. Behind a smooth boundary, the ray is sent to the point where l meets the plane through the
// middle of the lamp, and counts only if that lamp is seen from y.
//
// After Hanika, Droske, Fascione, "Manifold next event estimation", EGSR 2015, who look for y.

// From scatterings of the paths in slots i, i + 1 ..., towards lights that were drawn from there.
// Roulette before anything is traced, as of other shadow rays (send_shadow_rays). What they will
// carry is not known yet: where the aim was good a rough boundary lets through about q / index^2,
// and it may let 1 through where it was not.
inline void send_refracted_rays(Wavefront& wavefront, size_t i, Mask scattered, Uints medium,
                                Vectors position, const LightChoice& drawn,
                                const LightSamples& light, Floats roulette) {
  const FloatTag d;
  const Paths& paths = wavefront.paths;
  RefractedRays& refracted = wavefront.refracted_rays;
  const Floats one = set(1.0F);
  const Mask dense = light.dense();
  const Floats index = index_of(wavefront.media, medium);
  const Uints lamp = lamp_drawn(wavefront.scene.lights, drawn.choice);
  const Target target = wavefront.searches_facets
                            ? target_drawn(wavefront.scene.lights, position, lamp, light)
                            : far_target(light.direction);
  const Aim aim = first_aim(wavefront, medium, position, light.direction);
  Mask where = wavefront.searches_facets ? scattered : scattered & aim.possible;
  if (hn::AllFalse(d, where)) return;
  Vectors direction = if_then_else(aim.possible, aim.direction, light.direction);
  Floats pdf = light.pdf, passing = one;
  Floats light_pdf = one;  // of q s, what is not in `pdf`
  if (wavefront.boundary_is_delta) {
    pdf = light.pdf * hn::IfThenElse(aim.possible, aim.inner_by_outer, one);
    where &= hn::RebindMask(d, hn::Eq(target.lamp, lamp));
  } else {
    const Vectors axis = direction;
    if (!wavefront.searches_facets) {
      direction = draw_in_lobe(wavefront, medium, axis,
                               random(wavefront, i, load(paths.vertex, i), Sampler::kRefraction));
    }
    pdf = lobe_pdf(wavefront, medium, axis, direction);
    passing = mul_add(pdf, 1 / (index * index), one);
    light_pdf = hn::IfThenElse(dense, light.pdf, one);
  }
  const PhaseValue phase =
      evaluate_phase(wavefront.media, medium, dot(load(paths.rays.direction, i), direction));
  Floats radiance = light.radiance;
  if (wavefront.scene.lights.has_lamps() || wavefront.collected.map_gradient.asked()) {
    radiance = hn::Max(radiance, hn::IfThenElseZero(dense, set(wavefront.mean_radiance())));
  }
  const Floats worth = radiance * (phase.value * passing) / (light_pdf * (pdf + phase.value));
  const Floats importance = path_importance(wavefront, i) * worth;
  const Floats limit = depth_limit(wavefront, importance, roulette);
  const Floats limit_mm = limit * free_path_of(wavefront.media, medium);
  where &= (worth > 0) & (limit > 0);
  if (wavefront.searches_facets)
    where = hn::AndNot(limit_mm < least_depth(wavefront, position), where);

  const Append append{where, refracted.count};
  append_inside(append, position, direction,
                wavefront.searches_facets ? longest_search(wavefront, medium) : limit_mm,
                refracted.rays);
  append(slots_from(i), refracted.slot);
  append(importance, refracted.importance);
  append(light.pdf, refracted.light_pdf);
  if (wavefront.searches_facets) {  // what they bring is known later
    append(position, refracted.origin);
    append(target.place, refracted.target);
    append(load(paths.rays.direction, i), refracted.before);
    append(target.lamp, refracted.lamp);
    append(limit_mm, refracted.limit);
  } else {
    append(target.place, refracted.to_light);
    append(phase.value, refracted.phase);
    append(pdf, refracted.pdf);
  }
  if (!wavefront.boundary_is_delta) {
    append(light.radiance, refracted.radiance);
    if (wavefront.part_count > 0) append(light.source, refracted.source);
    if (wavefront.shadow_rays.rays.bounded) {
      append(drawn.choice, refracted.choice);
      append(drawn.uniforms.u0, refracted.u0);
      append(drawn.uniforms.u1, refracted.u1);
    }
  }
  const Scores& scores = wavefront.collected.scores;
  const size_t of_phase = wavefront.searches_facets ? 0 : scores.phase_count();
  for (size_t s = 0; s < refracted.scores.size(); ++s) {
    const Floats score = load(scores.of_path(s), i);
    append(s < of_phase ? score + phase.scores[s] : score, refracted.scores[s]);
  }
  refracted.count += hn::CountTrue(d, where);
}

// How they go on behind the boundary.
struct Exit {
  Vectors to_light;
  Floats distance, radiance;
  Uints source;         // as of LightSamples
  Floats per_radiance;  // what comes by radiance, its part that reaches the boundary apart
  Floats scores[kMaxBoundarySlots];
  Vectors normal_score = set(Vec3f{});  // see NormalScore
};

// Towards the light that was drawn.
HWY_INLINE Exit exit_of_rough(const Wavefront& wavefront, const RefractedRays& refracted, size_t i,
                              Uints medium, const Crossing& at, Floats arriving) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  LightSamples light{load(refracted.to_light, i), set(kInfinity), load(refracted.radiance, i),
                     load(refracted.light_pdf, i), load(refracted.source, i)};
  if (wavefront.shadow_rays.rays.bounded) {
    const LightChoice drawn{load(refracted.choice, i),
                            {zero, zero, load(refracted.u0, i), load(refracted.u1, i), Words{}}};
    light = seen_from(wavefront.scene.lights, load(refracted.rays.position, i), drawn, light);
  }
  Exit exit{light.direction, light.distance, light.radiance, light.source, one, {zero}};
  const BoundaryValue boundary = evaluate_boundary(wavefront.media, medium, at, exit.to_light);
  const Floats phase = load(refracted.phase, i), light_pdf = light.pdf;
  const Floats walk_pdf = phase * arriving;
  const Mask dense = light.dense();
  Floats pdf_sum = hn::IfThenElse(dense, light_pdf, one) * (load(refracted.pdf, i) + walk_pdf);
  if (wavefront.switches.techniques == Switches::Techniques::kBoth) {
    pdf_sum += hn::IfThenElseZero(dense, walk_pdf * boundary.pdf);
  }
  exit.per_radiance = phase * boundary.value / pdf_sum;
  for (size_t s = 0; s < kMaxBoundarySlots; ++s) exit.scores[s] = boundary.scores[s];
  if (at.asked.normal) exit.normal_score = slope_outwards(at, boundary.by_normal);
  return exit;
}

// Whereto the boundary refracts them, where there are any.
HWY_INLINE Exit exit_of_smooth(const Wavefront& wavefront, const RefractedRays& refracted, size_t i,
                               Uints medium, const Crossing& at, Floats arriving, Mask where) {
  const auto [direction, reflected] = transmit_boundary(wavefront.media, medium, at);
  const Vectors to_light = if_then_else(where, direction, set(Vec3f{0, 1, 0}));
  const Lights& lights = wavefront.scene.lights;
  const Vectors position = load(refracted.rays.position, i);
  const auto [distance, light] = look(lights, position, to_light);
  const Floats passing = load(refracted.phase, i) * (1 - reflected);
  const Uints lamp = lamp_seen(lights, position, to_light);
  const Mask as_drawn = hn::RebindMask(FloatTag(), hn::Eq(lamp, load(refracted.lamp, i)));
  return {
      to_light,
      distance,
      hn::IfThenElseZero(as_drawn, light.radiance),
      lamp,
      hn::IfThenElseZero(as_drawn, passing / mul_add(passing, arriving, load(refracted.pdf, i))),
      {hn::Zero(FloatTag())}};
}

// From the boundary they go on as shadow rays.
inline void leave(Wavefront& wavefront, const RefractedRays& refracted, size_t i, Uints medium,
                  Mask where) {
  const FloatTag d;
  if (hn::AllFalse(d, where)) return;
  const Floats zero = hn::Zero(d);
  const Vectors direction = load(refracted.rays.direction, i);
  const Vectors flat_normal = load(wavefront.crossings.normal, i);
  const Crossing crossing = crossing_of(
      direction, load(wavefront.crossings.smooth_normal, i), flat_normal, hn::FirstN(d, lanes()),
      wavefront.scene.obstacles.corner_normals.flat(), wavefront.boundary_derivatives);
  const Floats length = load(refracted.rays.medium_length, i);
  const Floats arriving = part_arriving(wavefront, medium, length);
  const Exit exit = wavefront.boundary_is_delta
                        ? exit_of_smooth(wavefront, refracted, i, medium, crossing, arriving, where)
                        : exit_of_rough(wavefront, refracted, i, medium, crossing, arriving);
  where &= (dot(flat_normal, exit.to_light) > 0) & (exit.per_radiance > 0);
  const Mask from_far = (load(refracted.light_pdf, i) > 0) & hn::Eq(exit.distance, set(kInfinity));
  const size_t of_phase = wavefront.collected.scores.phase_count();
  add_shadow_rays(wavefront, where,
                  {.position = load(refracted.rays.position, i),
                   .direction = exit.to_light,
                   .interaction = hn::Zero(UintTag()),
                   .slot = load(refracted.slot, i),
                   .light = exit.radiance * exit.per_radiance,
                   .source = exit.source,
                   .importance = load(refracted.importance, i),
                   .per_radiance = hn::IfThenElseZero(from_far, exit.per_radiance),
                   .distance = exit.distance,
                   .max_medium_length = zero,
                   .length_before = length,
                   .normal_score = exit.normal_score,
                   .triangle = load(wavefront.crossings.triangle, i)},
                  [&](size_t s) {
                    const Floats score = load(refracted.scores[s], i);
                    return s < of_phase ? score : score + exit.scores[s - of_phase];
                  });
}

// Rays in these directions, from where those began that searched for a facet.
struct AimedRays {
  Vectors direction;
  Floats pdf;  // with which that was drawn, per steradian, times that of the light if it is a delta
  Ints facet;
};
inline void add_aimed(Wavefront& wavefront, size_t i, Uints medium, Mask where,
                      const AimedRays& aimed) {
  const RefractedRays& refracted = wavefront.refracted_rays;
  RefractedRays& again = wavefront.aimed_again;
  const PhaseValue phase =
      evaluate_phase(wavefront.media, medium, dot(load(refracted.before, i), aimed.direction));
  const Append append{where, again.count};
  append_inside(append, load(refracted.origin, i), aimed.direction, load(refracted.limit, i),
                again.rays);
  append(load(refracted.slot, i), again.slot);
  append(load(refracted.importance, i), again.importance);
  append(phase.value, again.phase);
  append(aimed.pdf, again.pdf);
  append(load(refracted.light_pdf, i), again.light_pdf);
  if (wavefront.boundary_is_delta) {
    append(load(refracted.lamp, i), again.lamp);
    append(hn::BitCast(UintTag(), aimed.facet), again.facet);
  } else {
    append(target_of(wavefront, refracted, i).direction(), again.to_light);
    for_each_light_column(refracted, again,
                          [&](const auto& from, auto& to) { append(load(from, i), to); });
  }
  const size_t of_phase = wavefront.collected.scores.phase_count();
  for (size_t s = 0; s < refracted.scores.size(); ++s) {
    const Floats score = load(refracted.scores[s], i);
    append(s < of_phase ? score + phase.scores[s] : score, again.scores[s]);
  }
  again.count += hn::CountTrue(FloatTag(), where);
}

// In a lobe around an axis; `pdf_of(direction)` is the density of all lobes that it may be of.
template <typename PdfOf>
inline void aim_lobe(Wavefront& wavefront, size_t i, Ints slots, Uints medium, Mask where,
                     Vectors axis, const PdfOf& pdf_of) {
  if (hn::AllFalse(FloatTag(), where)) return;
  axis = if_then_else(where, axis, set(Vec3f{0, 1, 0}));
  const Vectors direction =
      draw_in_lobe(wavefront, medium, axis, refraction_words(wavefront, slots));
  add_aimed(wavefront, i, medium, where, {direction, pdf_of(direction), hn::Zero(IntTag())});
}

// At one of the facets around the one that they have met; returns where there is one.
inline Mask aim_again(Wavefront& wavefront, size_t i, Ints slots, Uints medium, Mask where) {
  const RefractedRays& refracted = wavefront.refracted_rays;
  if (hn::AllFalse(FloatTag(), where)) return where;
  const Vectors x = load(refracted.origin, i);
  const Floats u = uniform(refraction_words(wavefront, slots).w[0]);
  Mask found;
  const auto [count, facet, to] =
      choose_facet(wavefront, refracted, i, medium, where, u, set(~uint32_t{0}), x, found);
  const Mask solved = where & (count > 0);
  if (hn::AllFalse(FloatTag(), solved)) return solved;
  if (!wavefront.boundary_is_delta) {
    const Vectors axis = normalize(to);
    const bool one_each = hn::AllFalse(FloatTag(), solved & (count > 1));
    aim_lobe(wavefront, i, slots, medium, solved, axis, [&](Vectors direction) {
      return one_each ? lobe_pdf(wavefront, medium, axis, direction)
                      : sum_lobes(wavefront, refracted, i, medium, solved, direction).pdf / count;
    });
    return solved;
  }
  const Aim aim = aim_at_place(wavefront.scene.obstacles, facet, index_of(wavefront.media, medium),
                               x, target_of(wavefront, refracted, i), to);
  const Floats pdf = load(refracted.light_pdf, i) * aim.inner_by_outer / count;
  add_aimed(wavefront, i, medium, solved & (pdf > 0) & (pdf < kMostDensity),
            {aim.direction, pdf, facet});
  return solved;
}

inline void cross_refracted_rays(Wavefront& wavefront) {
  RefractedRays &first = wavefront.refracted_rays, &again = wavefront.aimed_again;
  if (!wavefront.searches_facets) {
    return follow_to_boundary(wavefront, first, [&](size_t i, Ints slots, Mask met) {
      leave(wavefront, first, i, wavefront.medium_in(slots), met);
    });
  }
  search_facets(
      wavefront, first,
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        return aim_again(wavefront, i, slots, medium, met);
      },
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        if (wavefront.boundary_is_delta) return;
        const Aim aim = first_aim_of(wavefront, first, i, medium, met);
        aim_lobe(wavefront, i, slots, medium, met & aim.possible, aim.direction,
                 [&](Vectors direction) {
                   return lobe_pdf(wavefront, medium, aim.direction, direction);
                 });
      });
  if (again.count == 0) return;
  follow_to_boundary(wavefront, again, [&](size_t i, Ints slots, Mask met) {
    if (wavefront.boundary_is_delta) {
      const auto as_aimed = hn::Eq(load(wavefront.crossings.triangle, i), load(again.facet, i));
      met &= hn::RebindMask(FloatTag(), as_aimed);
    }
    leave(wavefront, again, i, wavefront.medium_in(slots), met);
  });
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
