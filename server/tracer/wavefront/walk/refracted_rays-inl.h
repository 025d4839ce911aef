// Refracted shadow rays: next-event estimation through the boundary.
#if defined(ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/boundary/fresnel-inl.h"
#include "server/tracer/geometry/depth_grid-inl.h"
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
// which a smooth plane refracts the light, with the normal of the boundary nearby (CellNormals).
// Where the boundary is curved or far away, that aims badly, and the others find the light.
//
// Behind a smooth boundary, l follows from w. The walk finds it with p(w) T (1 - R), R being what
// the boundary reflects; a ray in the direction w into which that plane refracts a light that was
// drawn, with q(w) = s(l') dl'/dw, where l' is what the plane makes of w. The boundary makes l of
// it.
//
// A lamp is drawn by numbers, which make another l of it at x than at y: q is that at x, and s that
// at y, of the light that is seen in l. What lamps hide at x may be seen at y; so there is always a
// ray, unless a delta sends nothing to x.
//
// After Hanika, Droske, Fascione, "Manifold next event estimation", EGSR 2015, who look for y.

// A smooth plane between the media.
struct Plane {
  Vectors normal;  // outwards
  float index;     // of the medium, relative to what is around it
};

// As the boundary is where it is nearest to points of the medium.
HWY_INLINE Plane plane_near(const Wavefront& wave, Vectors x) {
  const Obstacles& obstacles = wave.scene.obstacles;
  return {cell_normal(obstacles.cell_normals, cells_at(obstacles.depth_grid.cells, x)),
          wave.refraction.index};
}
// Where it is nearest to what lies as far ahead as it is deep there.
HWY_INLINE Plane plane_ahead(const Wavefront& wave, Vectors x, Vectors direction) {
  const DepthGrid& depth_grid = wave.scene.obstacles.depth_grid;
  const Floats depth = quantized_depth(depth_grid, cells_at(depth_grid.cells, x));
  const auto third = static_cast<float>(depth_grid.cells.edge / 3);
  return plane_near(wave, x + direction * hn::Mul(depth, set(third)));
}

// What the plane refracts the direction of a path to, which goes outwards: from `outer` to inside,
// or from `inner` to outside.
struct Aim {
  Vectors direction;
  Mask possible;
  Floats inner_by_outer;  // density of `inner` over that of `outer`
};
HWY_INLINE Floats inner_by_outer(const Plane& plane, Floats inner_cosine, Floats outer_cosine) {
  const Floats least = set(1e-4F);  // along the plane
  return hn::Div(hn::Mul(set(plane.index * plane.index), inner_cosine),
                 hn::Max(outer_cosine, least));
}
HWY_INLINE Aim aim_at(const Plane& plane, Vectors outer) {
  const Floats zero = hn::Zero(FloatTag()), index = set(plane.index);
  const Vectors none{zero, zero, zero};
  const Floats facing = dot(plane.normal, outer), cosine = hn::Max(facing, zero);
  const Floats inner_cosine = fresnel(cosine, index).refracted_cosine;
  return {none - refracted(none - outer, plane.normal, cosine, inner_cosine, index),
          hn::Gt(facing, zero), inner_by_outer(plane, inner_cosine, cosine)};
}
HWY_INLINE Aim aim_along(const Plane& plane, Vectors inner) {
  const Floats zero = hn::Zero(FloatTag()), index = set(1 / plane.index);
  const Vectors none{zero, zero, zero};
  const Floats facing = dot(plane.normal, inner), cosine = hn::Max(facing, zero);
  const Floats outer_cosine = fresnel(cosine, index).refracted_cosine;
  return {refracted(inner, none - plane.normal, cosine, outer_cosine, index),
          hn::And(hn::Gt(facing, zero), hn::Gt(outer_cosine, zero)),
          inner_by_outer(plane, cosine, outer_cosine)};
}

HWY_INLINE Vectors scattered_at(const Paths& paths, size_t i) {
  const auto& at = paths.scattered_at;
  return {load(at[0], i), load(at[1], i), load(at[2], i)};
}

// The density q for paths that arrive at the boundary; `to_light` is the light's direction as it is
// seen from where they scattered, or 0, unless the boundary is smooth.
HWY_INLINE Floats aimed_pdf(const Wavefront& wave, size_t i, Vectors to_light) {
  const Vectors direction = load(wave.paths.rays.direction, i);
  const Vectors x = scattered_at(wave.paths, i);
  if (wave.boundary_is_delta) {
    const Aim aim = aim_along(plane_near(wave, x), direction);
    const Vectors outer = if_then_else(aim.possible, aim.direction, direction);
    const Floats pdf = drawn_pdf(wave.scene.lights, x, outer);
    return hn::IfThenElseZero(aim.possible, hn::Mul(pdf, aim.inner_by_outer));
  }
  const Aim aim = aim_at(plane_ahead(wave, x, to_light), to_light);
  return hn::IfThenElseZero(aim.possible,
                            evaluate(wave.refraction.lobe, dot(aim.direction, direction)).value);
}

// Where paths in slots i, i + 1 ... are at the boundary, which lets `passing` of what the walk
// sends there through: the odds for light in the direction `to_light` (aimed_pdf).
HWY_INLINE Floats refraction_odds(const Wavefront& wave, size_t i, Vectors to_light,
                                  Floats passing) {
  const Floats walk_pdf = load(wave.paths.scattered_pdf[0], i);
  const Mask scattered = hn::Gt(hn::Mul(walk_pdf, passing), hn::Zero(FloatTag()));
  if (hn::AllFalse(FloatTag(), scattered)) return hn::Zero(FloatTag());
  const Floats arriving =
      hn::Mul(passing, exp(hn::Mul(load(wave.paths.rays.medium_length, i), set(-wave.sigma_t))));
  return hn::IfThenElseZero(scattered,
                            hn::Div(aimed_pdf(wave, i, to_light), hn::Mul(walk_pdf, arriving)));
}

// From scatterings of the paths in slots i, i + 1 ..., towards lights that were drawn from there.
// Roulette before anything is traced, as of other shadow rays (send_shadow_rays). What they will
// carry is not known yet: where the aim was good a rough boundary lets through about q / index^2,
// and it may let 1 through where it was not.
inline void send_refracted_rays(Wavefront& wave, size_t i, Mask scattered, Vectors position,
                                const LightChoice& drawn, const LightSamples& light,
                                const LightParts& parts, Floats roulette) {
  const FloatTag d;
  const Paths& paths = wave.paths;
  RefractedRays& sent = wave.refracted_rays;
  const Floats zero = hn::Zero(d), one = set(1.0F);
  const Mask dense = light.dense();
  const Aim aim = aim_at(wave.boundary_is_delta ? plane_near(wave, position)
                                                : plane_ahead(wave, position, light.direction),
                         light.direction);
  Mask where = hn::And(scattered, aim.possible);
  if (hn::AllFalse(d, where)) return;
  Vectors direction = aim.direction;
  const bool has_lamps = wave.scene.lights.has_lamps();
  Floats pdf = light.pdf, passing = one;
  Floats light_pdf = one;  // of q s, what is not in `pdf`
  if (wave.boundary_is_delta) {
    // Whatever is seen there: behind the boundary something else may be.
    if (has_lamps) pdf = drawn_pdf(wave.scene.lights, position, light.direction);
    pdf = hn::Mul(pdf, aim.inner_by_outer);
  } else {
    const Words words = random(wave, i, load(paths.vertex, i), Sampler::kRefraction);
    const Floats cosine = sample_cosine(wave.refraction.lobe, uniform(words.w[0]));
    const Floats sine = hn::Sqrt(hn::Max(zero, hn::Sub(one, hn::Mul(cosine, cosine))));
    const SinCos phi = sin_cos_2pi(uniform(words.w[1]));
    direction = renormalize(
        frame_to_world(aim.direction, hn::Mul(sine, phi.cos), hn::Mul(sine, phi.sin), cosine));
    pdf = evaluate(wave.refraction.lobe, cosine).value;
    passing = mul_add(pdf, set(1 / (wave.refraction.index * wave.refraction.index)), one);
    light_pdf = hn::IfThenElse(dense, light.pdf, one);
  }
  const PhaseValue phase = evaluate(wave.phase, dot(load(paths.rays.direction, i), direction));
  Floats radiance = light.radiance;
  if (has_lamps || wave.differentiated_map != nullptr) {
    radiance = hn::Max(radiance, hn::IfThenElseZero(dense, set(wave.mean_radiance())));
  }
  const Floats worth = hn::Div(hn::Mul(radiance, hn::Mul(phase.value, passing)),
                               hn::Mul(light_pdf, hn::Add(pdf, phase.value)));
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
  if (wave.shadow_rays.rays.bounded) {
    append(drawn.choice, sent.choice);
    append(drawn.uniforms.u0, sent.u0);
    append(drawn.uniforms.u1, sent.u1);
  }
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

// How they go on behind the boundary.
struct Exit {
  Vectors to_light;
  Floats distance, radiance;
  Floats per_radiance;  // what comes by radiance, its part that reaches the boundary apart
  Floats scores[kMaxBoundarySlots];
  Floats parts_of_lights[kMaxDerivatives];  // of `radiance`
};

// Towards the light that was drawn.
HWY_INLINE Exit exit_of_rough(const Wavefront& wave, size_t i, const Crossing& at,
                              Floats arriving) {
  const RefractedRays& sent = wave.refracted_rays;
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  LightSamples light{load(sent.to_light, i), set(kInfinity), load(sent.radiance, i),
                     load(sent.light_pdf, i)};
  LightParts parts(wave.differentiated_lights);
  if (wave.shadow_rays.rays.bounded) {
    const LightChoice drawn{load(sent.choice, i),
                            {zero, zero, load(sent.u0, i), load(sent.u1, i), Words{}}};
    light = seen_from(wave.scene.lights, load(sent.rays.position, i), drawn, light, parts);
  }
  Exit exit{light.direction, light.distance, light.radiance, one, {zero}, {zero}};
  const BoundaryValue boundary = evaluate(wave.scene.boundary, at, exit.to_light);
  const Floats phase = load(sent.phase, i), light_pdf = light.pdf;
  const Floats walk_pdf = hn::Mul(phase, arriving);
  const Mask dense = light.dense();
  Floats pdf_sum =
      hn::Mul(hn::IfThenElse(dense, light_pdf, one), hn::Add(load(sent.pdf, i), walk_pdf));
  if (wave.switches.techniques == Switches::Techniques::kBoth) {
    pdf_sum = hn::Add(pdf_sum, hn::IfThenElseZero(dense, hn::Mul(walk_pdf, boundary.pdf)));
  }
  exit.per_radiance = hn::Div(hn::Mul(phase, boundary.value), pdf_sum);
  for (size_t s = 0; s < kMaxBoundarySlots; ++s) exit.scores[s] = boundary.scores[s];
  for (size_t l = 0; l < sent.parts_of_lights.size(); ++l) {
    exit.parts_of_lights[l] = wave.shadow_rays.rays.bounded ? part_of_light(light, parts, l)
                                                            : load(sent.parts_of_lights[l], i);
  }
  return exit;
}

// Whereto the boundary refracts them, where there are any.
HWY_INLINE Exit exit_of_smooth(const Wavefront& wave, size_t i, const Crossing& at, Floats arriving,
                               Mask where) {
  const RefractedRays& sent = wave.refracted_rays;
  const auto [direction, reflected] = transmit(wave.scene.boundary, at);
  const Vectors to_light = if_then_else(where, direction, set(Vec3f{0, 1, 0}));
  LightParts parts(wave.differentiated_lights);
  const auto [distance, light] =
      look(wave.scene.lights, load(sent.rays.position, i), to_light, parts);
  const Floats passing = hn::Mul(load(sent.phase, i), hn::Sub(set(1.0F), reflected));
  Exit exit{to_light,
            distance,
            light.radiance,
            hn::Div(passing, mul_add(passing, arriving, load(sent.pdf, i))),
            {hn::Zero(FloatTag())},
            {hn::Zero(FloatTag())}};
  for (size_t l = 0; l < sent.parts_of_lights.size(); ++l) {
    exit.parts_of_lights[l] = parts.radiance[l];
  }
  return exit;
}

// Follows them to the boundary, from where they go on as shadow rays.
inline void cross_refracted_rays(Wavefront& wave) {
  RefractedRays& sent = wave.refracted_rays;
  const FloatTag d;
  const Floats zero = hn::Zero(d);
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
    const Crossing at = crossing_of(
        direction, load(wave.crossings.smooth_normal, i), flat_normal, hn::FirstN(d, lanes()),
        wave.scene.obstacles.corner_normals.flat(), wave.index_slot.has_value());
    const Floats length = load(sent.rays.medium_length, i);
    const Floats arriving = exp(hn::Mul(length, set(-wave.sigma_t)));
    const Exit exit = wave.boundary_is_delta ? exit_of_smooth(wave, i, at, arriving, where)
                                             : exit_of_rough(wave, i, at, arriving);
    where = hn::And(where, hn::And(hn::Gt(dot(flat_normal, exit.to_light), zero),
                                   hn::Gt(exit.per_radiance, zero)));

    const Mask from_far =
        hn::And(hn::Gt(load(sent.light_pdf, i), zero), hn::Eq(exit.distance, set(kInfinity)));
    const size_t phase_slots = wave.paths.control_phase.size();
    add_shadow_rays(
        wave, where,
        {.position = load(sent.rays.position, i),
         .direction = exit.to_light,
         .interaction = hn::Zero(UintTag()),
         .slot = load(sent.slot, i),
         .light = hn::Mul(exit.radiance, exit.per_radiance),
         .importance = load(sent.importance, i),
         .per_radiance = hn::IfThenElseZero(from_far, exit.per_radiance),
         .distance = exit.distance,
         .max_medium_length = zero,
         .length_before = length},
        [&](size_t s) {
          const Floats score = load(sent.score_slots[s], i);
          return s < phase_slots ? score : hn::Add(score, exit.scores[s - phase_slots]);
        },
        [&](size_t l) { return hn::Mul(exit.parts_of_lights[l], exit.per_radiance); });
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
