// Vertices: scatterings in the medium, and diffuse reflections.
#if defined(ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <numbers>

#include "server/tracer/geometry/lines/surface_search-inl.h"
#include "server/tracer/surfaces/reflectance.h"
#include "server/tracer/wavefront/walk/shadow_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Whether triangles are of a range: from `first` on, and before `end`.
HWY_INLINE Mask among(Surfaces::Range range, Ints triangles) {
  const auto below = [](uint32_t n) { return hn::Set(IntTag(), static_cast<int32_t>(n) - 1); };
  return hn::RebindMask(FloatTag(), hn::AndNot(hn::Gt(triangles, below(range.end)),
                                               hn::Gt(triangles, below(range.first))));
}

HWY_INLINE Vertices vertices_of(const Paths& paths, const Surfaces& surfaces, float albedo,
                                size_t i, Mask where, Mask in_medium) {
  const FloatTag d;
  const Vectors before = load(paths.rays.direction, i);
  Vertices vertices{.where = where,
                    .in_medium = in_medium,
                    .all_in_medium = hn::AllTrue(d, hn::Or(in_medium, hn::Not(where))),
                    .axis = before,
                    .factor = set(albedo),
                    .triangles = hn::Set(IntTag(), -1)};
  if (!vertices.all_in_medium) {
    const Floats zero = hn::Zero(d);
    const auto on_surface = for_uints(hn::AndNot(in_medium, where));
    const Uints triangle = surface_of(load(paths.rays.interaction, i));
    const Ints at = hn::BitCast(IntTag(), hn::IfThenElseZero(on_surface, triangle));
    vertices.triangles =
        hn::BitCast(IntTag(), hn::IfThenElse(on_surface, triangle, set(Surfaces::kNone)));
    Floats reflectance = gather(surfaces.reflectances.data(), at);
    for (const Surfaces::Pattern& pattern : surfaces.patterned) {
      reflectance = hn::IfThenElse(
          among(pattern.triangles, vertices.triangles),
          reflectance_at(pattern.reflectance, load(paths.rays.position, i)), reflectance);
    }
    vertices.factor = hn::IfThenElse(in_medium, vertices.factor, reflectance);
    const Vectors normal{gather(surfaces.normals.x.data(), at),
                         gather(surfaces.normals.y.data(), at),
                         gather(surfaces.normals.z.data(), at)};
    const Mask flip = hn::Ge(dot(normal, before), zero);
    const Vectors facing = if_then_else(flip, Vectors{zero, zero, zero} - normal, normal);
    vertices.axis = if_then_else(in_medium, before, facing);
  }
  return vertices;
}

// W takes the factor. dW/d albedo takes it too, and W where the factor is the albedo; likewise
// dW/d reflectance, for the reflectance of some triangles.
HWY_INLINE void multiply_by_factor(Wavefront& wave, size_t i, const Vertices& vertices) {
  Paths& paths = wave.paths;
  const Floats factor = vertices.factor, weight = load(paths.weight, i);
  store(hn::Mul(weight, factor), paths.weight, i);
  store(hn::Add(hn::Mul(load(paths.dweight_dalbedo, i), factor),
                hn::IfThenElseZero(vertices.in_medium, weight)),
        paths.dweight_dalbedo, i);
  for (size_t a = 0; a < paths.weight_at_albedos.size(); ++a) {
    FloatColumn& other_weight = paths.weight_at_albedos[a];
    const Floats albedo = set(static_cast<float>(wave.request.albedos[a]));
    store(hn::Mul(load(other_weight, i), hn::IfThenElse(vertices.in_medium, albedo, factor)),
          other_weight, i);
  }
  for (size_t r = 0; r < wave.reflecting.size(); ++r) {
    const auto& [triangles, reflectance, slot] = wave.reflecting[r];
    const Floats slope = reflectance_slope(reflectance, slot, load(paths.rays.position, i));
    FloatColumn& derivative = paths.dweight_dreflectance[r];
    const Floats gain =
        hn::IfThenElseZero(among(triangles, vertices.triangles), hn::Mul(weight, slope));
    store(mul_add(load(derivative, i), factor, gain), derivative, i);
  }
}

// Draws the next direction: by the phase function around the last one, or the cosine law around the
// normal (its pdf is cosine / pi: cosine^2 is uniform).
HWY_INLINE void sample_direction(Wavefront& wave, size_t i, const Vertices& vertices) {
  Paths& paths = wave.paths;
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  const Floats u1 = load(paths.u1, i);
  Floats cosine = sample_cosine(wave.phase, u1);
  Floats sine = hn::Sqrt(hn::Max(zero, hn::Sub(one, hn::Mul(cosine, cosine))));
  const PhaseValue phase = evaluate(wave.phase, cosine);
  Floats pdf = phase.value;
  if (!vertices.all_in_medium) {
    const Mask in_medium = vertices.in_medium;
    const Floats diffuse = hn::Sqrt(hn::Sub(one, u1));
    cosine = hn::IfThenElse(in_medium, cosine, diffuse);
    sine = hn::IfThenElse(in_medium, sine, hn::Sqrt(u1));
    pdf = hn::IfThenElse(in_medium, pdf, hn::Mul(diffuse, set(std::numbers::inv_pi_v<float>)));
  }
  const SinCos phi = sin_cos_2pi(load(paths.u2, i));
  const Vectors direction = renormalize(
      frame_to_world(vertices.axis, hn::Mul(sine, phi.cos), hn::Mul(sine, phi.sin), cosine));
  // Paths that have ended keep their direction: NaN would slow the lanes down.
  const Vectors before = load(paths.rays.direction, i);
  store(if_then_else(vertices.where, direction, before), paths.rays.direction, i);
  store(pdf, paths.pdf, i);
  // A control variate, as in update_scores.
  for (size_t s = 0; s < paths.score_phase.size(); ++s) {
    const Floats score = hn::IfThenElseZero(vertices.in_medium, phase.scores[s]);
    FloatColumn &sum = paths.score_phase[s], &control = paths.control_phase[s];
    store(hn::Add(load(sum, i), score), sum, i);
    store(mul_add(score, load(paths.weight, i), load(control, i)), control, i);
  }
  store(hn::IfThenZeroElse(for_uints(vertices.where), load(paths.delta_bounce, i)),
        paths.delta_bounce, i);
}

// What happens at the vertices of the paths in slots i, i + 1 ..., where there are any.
inline void scatter(Wavefront& wave, size_t i, Mask where, Mask in_medium) {
  Vertices vertices =
      vertices_of(wave.paths, wave.scene.obstacles.surfaces, wave.albedo, i, where, in_medium);
  if (wave.stops_at_boundary) {
    // Paths at the boundary keep their weight.
    vertices.factor = hn::IfThenElse(where, vertices.factor, set(1.0F));
    UintColumn& crossings = wave.paths.crossings;
    store(hn::IfThenZeroElse(for_uints(where), load(crossings, i)), crossings, i);
  }
  multiply_by_factor(wave, i, vertices);
  if (wave.switches.techniques != Switches::Techniques::kPhaseOnly) {
    send_shadow_rays(wave, i, vertices);
  }
  sample_direction(wave, i, vertices);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
