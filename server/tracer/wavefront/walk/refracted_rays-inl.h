// Refracted shadow rays: next-event estimation through the boundary.
#if defined(ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/boundary/fresnel-inl.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/phase/henyey_greenstein.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Light that leaves the medium through a boundary which refracts comes from a scattering at x to a
// point y of the boundary in direction w, and from there towards a light in direction l. With p the
// phase function, T the part of flights that reach y, b the density that the boundary draws l with
// and s that of the lights, three techniques find it, with these densities:
//
//   p(w) T b(l)   the walk flies to y, and meets the light behind it by itself
//   p(w) T s(l)   it flies to y, and sends a shadow ray from there
//   q(w) s(l)     x draws a light and sends a ray to y that is refracted towards it
//
// All are weighed by the balance heuristic. The second finds a small light in the few directions w
// that are refracted towards it alone, so it is noisy where light is not even; the third looks
// there. How likely it is against the walk, q / (p T), are its odds.
//
// q is a lobe of Henyey and Greenstein as wide as the boundary is rough, around the direction into
// which a smooth plane refracts the light, with the normal of where the path has last met the
// boundary. Where the path has come far from there, or the boundary is curved, that aims badly, and
// the others find the light.
//
// After Hanika, Droske, Fascione, "Manifold next event estimation", EGSR 2015, who look for y.

// The middle of the lobe q, for a light in that direction; and whether its light comes in there.
struct Aim {
  Vectors axis;
  Mask possible;
};
HWY_INLINE Aim aim_at(const Wavefront& wave, Vectors normal, Vectors to_light) {
  const Floats zero = hn::Zero(FloatTag()), index = set(wave.refraction.index);
  const Vectors none{zero, zero, zero};
  const Floats facing = dot(normal, to_light), cosine = hn::Max(facing, zero);
  const Floats inner = fresnel(cosine, index).refracted_cosine;
  return {none - refracted(none - to_light, normal, cosine, inner, index), hn::Gt(facing, zero)};
}

// Where paths in slots i, i + 1 ... are at the boundary: the odds for light that is `distance` away
// in the direction `to_light`.
HWY_INLINE Floats refraction_odds(const Wavefront& wave, size_t i, Vectors to_light,
                                  Floats distance) {
  const Paths& paths = wave.paths;
  const Floats zero = hn::Zero(FloatTag()), walk_pdf = load(paths.scattered_pdf[0], i);
  const Mask scattered = hn::Gt(walk_pdf, zero);
  const Vectors direction = load(paths.rays.direction, i);
  const Floats length = load(paths.rays.medium_length, i);
  if (wave.shadow_rays.rays.bounded) {  // the light is seen in another direction from x
    const Mask near = hn::Lt(distance, set(kInfinity));
    const Floats reach = hn::IfThenElse(near, distance, set(1.0F));
    const Vectors from_x = direction * hn::IfThenElseZero(near, length) + to_light * reach;
    to_light = if_then_else(hn::And(scattered, near), normalize(from_x), to_light);
  }
  const Vectors normal{load(paths.last_normal[0], i), load(paths.last_normal[1], i),
                       load(paths.last_normal[2], i)};
  const Aim aim = aim_at(wave, normal, to_light);
  const Floats aimed_pdf = evaluate(wave.refraction.lobe, dot(aim.axis, direction)).value;
  const Floats arriving = exp(hn::Mul(length, set(-wave.sigma_t)));
  return hn::IfThenElseZero(hn::And(scattered, aim.possible),
                            hn::Div(aimed_pdf, hn::Mul(walk_pdf, arriving)));
}

// From scatterings of the paths in slots i, i + 1 ..., towards lights that were drawn from there.
// Roulette before anything is traced, as of other shadow rays (send_shadow_rays). What they will
// carry is not known yet: where the aim was good the boundary lets through about q / index^2, and
// it may let 1 through where it was not.
inline void send_refracted_rays(Wavefront& wave, size_t i, Mask scattered, Vectors position,
                                const LightSamples& light, const LightParts& parts,
                                Floats roulette) {
  const FloatTag d;
  const Paths& paths = wave.paths;
  RefractedRays& sent = wave.refracted_rays;
  const Floats zero = hn::Zero(d), one = set(1.0F);
  const Vectors normal{load(paths.last_normal[0], i), load(paths.last_normal[1], i),
                       load(paths.last_normal[2], i)};
  const Aim aim = aim_at(wave, normal, light.direction);
  Mask where = hn::And(scattered, aim.possible);
  if (hn::AllFalse(d, where)) return;
  const Words words = random(wave, i, load(paths.vertex, i), Sampler::kRefraction);
  const Floats cosine = sample_cosine(wave.refraction.lobe, uniform(words.w[0]));
  const Floats sine = hn::Sqrt(hn::Max(zero, hn::Sub(one, hn::Mul(cosine, cosine))));
  const SinCos phi = sin_cos_2pi(uniform(words.w[1]));
  const Vectors direction =
      renormalize(frame_to_world(aim.axis, hn::Mul(sine, phi.cos), hn::Mul(sine, phi.sin), cosine));
  const PhaseValue phase = evaluate(wave.phase, dot(load(paths.rays.direction, i), direction));

  const Mask dense = hn::Gt(light.pdf, zero);
  Floats radiance = hn::Div(light.radiance, hn::IfThenElse(dense, light.pdf, one));
  if (wave.differentiated_map != nullptr) {
    const Floats mean = set(wave.mean_radiance());
    radiance = hn::Max(radiance, hn::IfThenElseZero(dense, hn::Div(mean, light.pdf)));
  }
  const Floats pdf = evaluate(wave.refraction.lobe, cosine).value;
  const Floats passing =
      mul_add(pdf, set(1 / (wave.refraction.index * wave.refraction.index)), one);
  const Floats worth =
      hn::Mul(radiance, hn::Div(hn::Mul(phase.value, passing), hn::Add(pdf, phase.value)));
  const Floats importance = hn::Mul(path_importance(paths, i), worth);
  const Floats limit = depth_limit(wave, importance, roulette);
  where = hn::And(where, hn::And(hn::Gt(worth, zero), hn::Gt(limit, zero)));

  const Append append{where, sent.count};
  append(position, sent.rays.position);
  append(direction, sent.rays.direction);
  append(set(Rays::kInside), sent.rays.interaction);
  append(hn::Mul(limit, set(1 / wave.sigma_t)), sent.rays.max_medium_length);
  append(slots_from(i), sent.slot);
  append(importance, sent.importance);
  append(phase.value, sent.phase);
  append(pdf, sent.pdf);
  append(light.direction, sent.to_light);
  append(light.distance, sent.distance);
  append(light.radiance, sent.radiance);
  append(light.pdf, sent.light_pdf);
  const size_t phase_slots = paths.control_phase.size();
  for (size_t s = 0; s < sent.score_slots.size(); ++s) {
    const Floats score = load(paths.score_slots[s], i);
    append(s < phase_slots ? hn::Add(score, phase.scores[s]) : score, sent.score_slots[s]);
  }
  for (size_t l = 0; l < sent.parts_of_lights.size(); ++l) {
    append(part_of_light(light, parts, l), sent.parts_of_lights[l]);
  }
  sent.count += hn::CountTrue(d, where);
}

// Follows them to the boundary, from where they go on as shadow rays.
inline void cross_refracted_rays(Wavefront& wave) {
  RefractedRays& sent = wave.refracted_rays;
  ShadowRays& shadow_rays = wave.shadow_rays;
  const FloatTag d;
  const Floats zero = hn::Zero(d), one = set(1.0F);
  follow_lines(wave.scene.obstacles, sent.rays, sent.count, Report::kEnds, &wave.crossings);
  for (size_t i = 0; i < sent.count; i += lanes()) {
    const Mask live = hn::FirstN(d, sent.count - i);
    const Uints end = hn::And(load(sent.rays.outcome, i), set(Rays::kEndMask));
    mark_leaked(wave.paths, hn::And(live, equals(end, Rays::kLeaked)),
                slots_in(sent.slot, i, live));
    Mask where = hn::And(live, equals(end, Rays::kCrossing));
    if (hn::AllFalse(d, where)) continue;

    const Vectors direction = load(sent.rays.direction, i);
    const Vectors flat_normal = load(wave.crossings.normal, i);
    const Crossing at =
        crossing_of(direction, load(wave.crossings.smooth_normal, i), flat_normal,
                    hn::FirstN(d, lanes()), wave.scene.obstacles.corner_normals.flat());
    const Floats length = load(sent.rays.medium_length, i);
    Vectors to_light = load(sent.to_light, i);
    Floats distance = load(sent.distance, i), nearer = one;
    if (shadow_rays.rays.bounded) {  // the light is seen in another direction from y
      const Mask near = hn::Lt(distance, set(kInfinity));
      const Vectors from_y = to_light * hn::IfThenElse(near, distance, one) -
                             direction * hn::IfThenElseZero(near, length);
      const Floats from_y_2 = dot(from_y, from_y), from_y_length = hn::Sqrt(from_y_2);
      nearer = hn::IfThenElse(near, hn::Div(hn::Mul(distance, distance), from_y_2), one);
      to_light = if_then_else(near, from_y * hn::Div(one, from_y_length), to_light);
      distance = hn::IfThenElse(near, from_y_length, distance);
    }
    const BoundaryValue boundary = evaluate(wave.scene.boundary, at, to_light);
    where = hn::And(
        where, hn::And(hn::Gt(dot(flat_normal, to_light), zero), hn::Gt(boundary.value, zero)));

    // Light by radiance, its part that arrives at y apart.
    const Floats phase = load(sent.phase, i), light_pdf = load(sent.light_pdf, i);
    const Floats walk_pdf = hn::Mul(phase, exp(hn::Mul(length, set(-wave.sigma_t))));
    const Floats boundary_pdf =
        wave.switches.techniques == Switches::Techniques::kBoth ? boundary.pdf : zero;
    const Mask dense = hn::Gt(light_pdf, zero);
    const Floats drawn_pdf =
        hn::Mul(hn::IfThenElse(dense, light_pdf, one), hn::Add(load(sent.pdf, i), walk_pdf));
    const Floats pdf_sum =
        hn::Add(drawn_pdf, hn::IfThenElseZero(dense, hn::Mul(walk_pdf, boundary_pdf)));
    const Floats per_radiance = hn::Div(hn::Mul(hn::Mul(phase, boundary.value), nearer), pdf_sum);

    const Append append{where, shadow_rays.count};
    append(load(sent.rays.position, i), shadow_rays.rays.position);
    append(to_light, shadow_rays.rays.direction);
    append(hn::Zero(UintTag()), shadow_rays.rays.interaction);
    append(zero, shadow_rays.rays.max_medium_length);
    if (shadow_rays.rays.bounded) append(distance, shadow_rays.rays.distance);
    append(length, shadow_rays.length_before);
    append(load(sent.slot, i), shadow_rays.slot);
    append(load(sent.importance, i), shadow_rays.importance);
    append(hn::Mul(load(sent.radiance, i), per_radiance), shadow_rays.light);
    if (wave.differentiated_map != nullptr) {
      append(hn::IfThenElseZero(dense, per_radiance), shadow_rays.per_radiance[0]);
    }
    const size_t phase_slots = wave.paths.control_phase.size();
    for (size_t s = 0; s < sent.score_slots.size(); ++s) {
      const Floats score = load(sent.score_slots[s], i);
      append(s < phase_slots ? score : hn::Add(score, boundary.scores[s - phase_slots]),
             shadow_rays.score_slots[s]);
    }
    for (size_t l = 0; l < sent.parts_of_lights.size(); ++l) {
      append(hn::Mul(load(sent.parts_of_lights[l], i), per_radiance),
             shadow_rays.parts_of_lights[l]);
    }
    shadow_rays.count += hn::CountTrue(d, where);
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
