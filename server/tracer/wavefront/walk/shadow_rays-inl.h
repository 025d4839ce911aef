// Shadow rays: next-event estimation.
#if defined(ITN_TRACER_WAVEFRONT_WALK_SHADOW_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_SHADOW_RAYS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_SHADOW_RAYS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_SHADOW_RAYS_INL_H_
#endif

#include <cstddef>
#include <numbers>

#include "server/tracer/collected/vertices-inl.h"
#include "server/tracer/geometry/lines/lines-inl.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/wavefront/walk/contribution-inl.h"
#include "server/tracer/wavefront/walk/refracted_rays-inl.h"
#include "server/tracer/wavefront/walk/refraction_odds-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The paths from which shadow rays are sent that do not end at the boundary of the medium.
HWY_INLINE Mask sending(const Wavefront& wavefront, size_t i, const Vertices& vertices) {
  if (!wavefront.stops_at_boundary) return vertices.where();
  const Mask inside = is_inside(load(wavefront.paths.rays.interaction, i));
  const Mask outside = hn::AndNot(inside, vertices.on_surface);
  return wavefront.boundary_is_delta ? outside : outside | vertices.at_boundary;
}

// Whether some send refracted ones.
HWY_INLINE bool any_refracted(const Wavefront& wavefront, const Vertices& vertices) {
  return wavefront.refracts_shadow_rays && !hn::AllFalse(FloatTag(), vertices.in_medium);
}

// Light that a smooth boundary mirrors to where paths come from, outside. It is not left to the
// walk, which is mirrored seldom, and may meet a sun then.
inline void send_mirrored_rays(Wavefront& wavefront, size_t i, const Vertices& vertices) {
  const FloatTag d;
  const Crossing& crossing = vertices.crossing;
  Mask sends = hn::AndNot(crossing.leaving, vertices.at_boundary);
  if (hn::AllFalse(d, sends)) return;
  const Vectors to_light = if_then_else(
      sends, on_its_side(crossing, mirrored(crossing.direction, crossing.normal), hn::FirstN(d, 0)),
      set(Vec3f{0, 1, 0}));
  const Vectors position =
      if_then_else(sends, load(wavefront.paths.rays.position, i), set(Vec3f{}));
  const Lights& lights = wavefront.scene.lights;
  const auto [distance, light] = look(lights, position, to_light);
  const Floats reflected = transmit_boundary(wavefront.media, vertices.medium, crossing).reflected;
  const Floats zero = hn::Zero(d), undimmed = light.radiance * reflected;
  if (!wavefront.collected.map_gradient.asked()) sends &= undimmed > 0;
  add_shadow_rays(wavefront, sends,
                  {.position = position,
                   .direction = to_light,
                   .interaction = hn::Zero(UintTag()),
                   .slot = slots_from(i),
                   .light = undimmed,
                   .source = lamp_seen(lights, position, to_light),
                   .importance = set(kInfinity),  // no roulette
                   .per_radiance = hn::IfThenElseZero(hn::Eq(distance, set(kInfinity)), reflected),
                   .distance = distance,
                   .max_medium_length = zero,
                   .length_before = zero},
                  [&](size_t s) { return load(wavefront.collected.scores.of_path(s), i); });
}

// Light that comes from a direction: the part of its radiance, by steradian, that paths carry on.
struct TurnValue {
  Floats value, pdf;                          // with which the walk would go there by itself
  PhaseValue phase;                           // of scatterings
  Floats boundary_scores[kMaxBoundarySlots];  // of crossings
  Vectors normal_score = set(Vec3f{});        // likewise: see NormalScore
};
HWY_INLINE TurnValue evaluate_turn(const Wavefront& wavefront, const Vertices& vertices,
                                   Vectors direction) {
  const Floats zero = hn::Zero(FloatTag());
  const Floats cosine = dot(vertices.axis, direction);
  const PhaseValue phase = evaluate_phase(wavefront.media, vertices.medium, cosine);
  TurnValue turn{phase.value, phase.value, phase, {zero}};
  if (vertices.any_on_surface) {
    Floats diffuse = hn::Max(zero, cosine) * std::numbers::inv_pi_v<float>;
    if (wavefront.scene.obstacles.surfaces.smooth()) {
      const Mask above = dot(vertices.flat_normal, direction) > 0;
      diffuse = hn::IfThenElseZero(above, diffuse);
    }
    turn.value = turn.pdf = hn::IfThenElse(vertices.on_surface, diffuse, phase.value);
  }
  if (vertices.any_at_boundary) {
    const Crossing& crossing = vertices.crossing;
    const BoundaryValue boundary =
        evaluate_boundary(wavefront.media, vertices.medium, crossing, direction);
    const Floats side =
        dot(crossing.flat_normal, direction);  // outside is above 0, unless it leaves
    const Mask outside = hn::IfThenElse(crossing.leaving, -side, side) > 0;
    turn.value = hn::IfThenElse(vertices.at_boundary, hn::IfThenElseZero(outside, boundary.value),
                                turn.value);
    turn.pdf = hn::IfThenElse(vertices.at_boundary, boundary.pdf, turn.pdf);
    for (size_t s = 0; s < kMaxBoundarySlots; ++s) {
      turn.boundary_scores[s] = hn::IfThenElseZero(vertices.at_boundary, boundary.scores[s]);
    }
    if (crossing.asked.normal) {
      turn.normal_score = if_then_else(
          vertices.at_boundary, slope_outwards(crossing, boundary.by_normal), turn.normal_score);
    }
  }
  return turn;
}

// Next-event estimation: light along one direction drawn from the lights.
//
// Roulette before anything is traced: a shadow ray through optical depth x carries v exp(-x). Let
// it survive with probability min(1, v exp(-x) / tau), carrying at least tau then: with one
// uniform number u that means x <= log(v / (u tau)), a limit on the depth that is known
// beforehand.
inline void send_shadow_rays(Wavefront& wavefront, size_t i, const Vertices& vertices) {
  const Paths& paths = wavefront.paths;
  const FloatTag d;
  if (wavefront.mirrors_shadow_rays && vertices.any_at_boundary)
    send_mirrored_rays(wavefront, i, vertices);
  Mask sends = sending(wavefront, i, vertices);
  const bool refracted = any_refracted(wavefront, vertices);
  if (hn::AllFalse(d, sends) && !refracted) return;
  const Floats zero = hn::Zero(d);
  const Uints vertex = load(paths.vertex, i);
  const Words words = random(wavefront, i, vertex, Sampler::kShadowRay);
  const Words more =
      wavefront.scene.lights.has_maps() ? random(wavefront, i, vertex, Sampler::kMap) : Words{};
  // Paths that have escaped are at no place.
  const Vectors position =
      if_then_else(vertices.where(), load(paths.rays.position, i), Vectors{zero, zero, zero});
  const LightChoice drawn = light_choice(words, more);
  const LightSamples light = sample(wavefront.scene.lights, position, drawn);
  const Floats roulette = 1 - fifth_uniform(words);
  if (refracted) {
    send_refracted_rays(wavefront, i, vertices.in_medium, vertices.medium, position, drawn, light,
                        roulette);
    if (hn::AllFalse(d, sends)) return;
  }
  const TurnValue turn = evaluate_turn(wavefront, vertices, light.direction);
  // The weight of the draw, radiance / pdf, times that of multiple importance sampling,
  // pdf / (pdf + walk_pdf). Deltas have no pdf: what they bring is as it is.
  const Floats phase_pdf =
      wavefront.switches.techniques == Switches::Techniques::kBoth ? turn.pdf : zero;
  Floats pdf_sum = hn::IfThenElse(light.dense(), light.pdf + phase_pdf, set(1.0F));
  const Floats light_pdf = hn::IfThenElse(light.dense(), light.pdf, set(1.0F));
  LightSamples from_scattering = light;
  const bool has_odds = wavefront.refracts_shadow_rays && vertices.any_at_boundary;
  if (has_odds && wavefront.shadow_rays.rays.bounded) {
    from_scattering = seen_from(wavefront.scene.lights, scattered_at(paths, i), drawn, light);
  }
  if (has_odds && !wavefront.searches_facets) {
    const Floats odds = refraction_odds(wavefront, i, vertices.medium, from_scattering.direction);
    pdf_sum += hn::IfThenElseZero(vertices.at_boundary, odds * light_pdf);
  }
  const Floats undimmed = light.radiance * turn.value / pdf_sum;
  // What decides whether it is sent. For a gradient in a panorama, dark places count as well.
  Floats worth = undimmed, per_radiance = zero;
  if (wavefront.collected.map_gradient.asked()) {
    per_radiance = hn::IfThenElseZero(light.from_far(), turn.value / pdf_sum);
    worth = hn::Max(worth, per_radiance * wavefront.mean_radiance());
  }
  const Floats importance = path_importance(wavefront, i) * worth;
  const Floats limit = depth_limit(wavefront, importance, roulette);
  sends &= (worth > 0) & (limit > 0);

  if (has_odds && wavefront.searches_facets) {
    const Target target =
        target_drawn(wavefront.scene.lights, scattered_at(paths, i),
                     lamp_drawn(wavefront.scene.lights, drawn.choice), from_scattering);
    send_lobe_odds(wavefront, wavefront.shadow_odds, i, sends & vertices.at_boundary,
                   vertices.medium, target, light_pdf / pdf_sum,
                   Append{sends, wavefront.shadow_rays.count}.numbers());
  }
  const Uints interaction = load(paths.rays.interaction, i);
  const Scores& scores = wavefront.collected.scores;
  const size_t of_phase = scores.phase_count();
  add_shadow_rays(wavefront, sends,
                  {.position = position,
                   .direction = light.direction,
                   .interaction = hn::IfThenZeroElse(for_uints(vertices.at_boundary), interaction),
                   .slot = slots_from(i),
                   .light = undimmed,
                   .source = light.source,
                   .importance = importance,
                   .per_radiance = per_radiance,
                   .distance = light.distance,
                   .max_medium_length = limit * free_path_of(wavefront.media, vertices.medium),
                   .length_before = zero,
                   .normal_score = turn.normal_score,
                   .triangle = load(wavefront.crossings.triangle, i)},
                  [&](size_t s) {
                    const Floats score =
                        s < of_phase ? hn::IfThenElseZero(vertices.in_medium, turn.phase.scores[s])
                                     : turn.boundary_scores[s - of_phase];
                    return load(scores.of_path(s), i) + score;
                  });
}

// Adds the light that shadow rays with such numbers bring, dimmed by the medium.
inline void add_arriving(Wavefront& wavefront, Ints numbers, Mask live) {
  const Paths& paths = wavefront.paths;
  const ShadowRays& shadow_rays = wavefront.shadow_rays;
  const SlotGather ray{numbers}, at{slots_where(live, ray.get(shadow_rays.slot))};
  Floats length = ray.get(shadow_rays.rays.medium_length);
  if (wavefront.refracts_shadow_rays) length += ray.get(shadow_rays.length_before);
  const Uints medium = wavefront.medium_in(at.slots);
  const Floats dimming = part_arriving(wavefront, medium, length);
  Floats survival = set(1.0F);
  if (wavefront.shadow_ray_threshold > 0) {
    survival = hn::Min(
        survival, ray.get(shadow_rays.importance) * dimming * (1 / wavefront.shadow_ray_threshold));
  }
  const auto arriving = [&](const FloatColumn& undimmed) {
    const Floats dimmed = ray.get(undimmed) * dimming;
    return hn::IfThenElseZero(live,
                              wavefront.shadow_ray_threshold > 0 ? dimmed / survival : dimmed);
  };
  const auto direction = [&] {
    return if_then_else(live, ray.get(shadow_rays.rays.direction), set(Vec3f{0, 1, 0}));
  };
  LightParts parts;
  if (wavefront.part_count > 0)
    find_parts(wavefront, direction(), ray.get(shadow_rays.source), parts);
  PathScores scores;
  for (size_t s = 0; s < shadow_rays.scores.size(); ++s)
    scores.of[s] = ray.get(shadow_rays.scores[s]);
  if (wavefront.collected.colours.asked()) {
    const Floats undimmed = ray.get(shadow_rays.light) / survival;
    at.add(wavefront.collected.colours.add(
               at, length,
               [&](size_t c) {
                 const Floats in_colour = exp(length * (-wavefront.collected.colours.sigma_t(c)));
                 return hn::IfThenElseZero(live, undimmed * parts.of[c] * in_colour);
               },
               scores),
           wavefront.paths.radiance);
    return;
  }
  const Floats light = arriving(shadow_rays.light);
  add_contribution(wavefront, at, light, of_object(wavefront.media, medium, length), parts, scores);
  if (wavefront.collected.map_gradient.asked()) {
    wavefront.collected.map_gradient.add(
        paths.pixel, paths.sample, direction(), live,
        at.get(paths.weight) * arriving(shadow_rays.per_radiance[0]), at.slots);
  }
  if (wavefront.collected.normal_gradient) {
    add_to_normals(wavefront, numbers, at.get(paths.weight) * light, at.slots);
  }
}

// Traces the shadow rays, and adds the light of those that arrive.
inline void trace_shadow_rays(Wavefront& wavefront) {
  ShadowRays& shadow_rays = wavefront.shadow_rays;
  follow_lines(wavefront.scene.obstacles, shadow_rays.rays, shadow_rays.count, Report::kLengths,
               wavefront.at_boundary());
  SlotList arrived;
  for (size_t i = 0; i < shadow_rays.count; i += lanes()) {
    const Mask live = hn::FirstN(FloatTag(), shadow_rays.count - i);
    const Uints end = load(shadow_rays.rays.outcome, i) & set(Rays::kEndMask);
    mark_leaked(wavefront.paths, live & equals(end, Rays::kLeaked),
                slots_in(shadow_rays.slot, i, live));
    arrived.add(i, live & equals(end, Rays::kEscaped));
  }
  arrived.for_each([&](Ints numbers, Mask live) { add_arriving(wavefront, numbers, live); });
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
