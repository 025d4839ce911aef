// Where refracted shadow rays are aimed (refracted_rays-inl.h).
#if defined(ITN_TRACER_WAVEFRONT_WALK_REFRACTION_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_REFRACTION_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_REFRACTION_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_REFRACTION_INL_H_
#endif

#include "server/tracer/geometry/depth_grid-inl.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/phase/henyey_greenstein.h"
#include "server/tracer/wavefront/walk/aim-inl.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The normal of the boundary where it is nearest to points of the medium.
HWY_INLINE Vectors normal_near(const Wavefront& wavefront, Vectors x) {
  const Obstacles& obstacles = wavefront.scene.obstacles;
  return cell_normal(obstacles.cell_normals, cells_at(obstacles.depth_grid.cells, x));
}
HWY_INLINE Floats index_of(const Media& media, Uints medium) {
  return by_medium(media, medium, [](const Medium& of) { return set(of.refraction.index); });
}
// The plane of the boundary where it is nearest to what lies as far ahead as it is deep there.
HWY_INLINE Plane plane_ahead(const Wavefront& wavefront, Uints medium, Vectors x,
                             Vectors direction) {
  const DepthGrid& depth_grid = wavefront.scene.obstacles.depth_grid;
  const Floats depth = quantized_depth(depth_grid, cells_at(depth_grid.cells, x));
  const auto third = static_cast<float>(depth_grid.cells.edge / 3);
  return {normal_near(wavefront, x + direction * (depth * third)),
          index_of(wavefront.media, medium)};
}

// The aim of the first ray from x for light in a direction `outer`.
HWY_INLINE Aim first_aim(const Wavefront& wavefront, Uints medium, Vectors x, Vectors outer) {
  return aim_at(wavefront.boundary_is_delta
                    ? Plane{normal_near(wavefront, x), index_of(wavefront.media, medium)}
                    : plane_ahead(wavefront, medium, x, outer),
                outer);
}

// The random numbers of refracted rays from the vertices of paths in any slots.
HWY_INLINE Words refraction_words(const Wavefront& wavefront, Ints slots) {
  const Paths& paths = wavefront.paths;
  return philox(gather(paths.vertex, slots), set(uint32_t{Sampler::kRefraction}),
                gather(paths.sample, slots), gather(paths.pixel, slots), wavefront.request.seed);
}

// What such rays are for, with `lamp` the one that the light is of, or 0; `distance` is that of
// what is no lamp.
HWY_INLINE Target target_at(const Lights& lights, Vectors x, Vectors outer, Uints lamp,
                            Floats distance) {
  LampMiddle middle{};
  if (lights.has_lamps()) {
    middle = seen_middle(lights, lamp, x);
    distance = hn::IfThenElse(not_zero(lamp), way_to_plane(middle, set(Vec3f{}), outer), distance);
  }
  const Mask is_point = distance < kInfinity;
  const Uints number = hn::IfThenElse(hn::Eq(lamp, hn::Zero(UintTag())), set(kPointLight), lamp);
  return {if_then_else(is_point, outer * distance, outer),
          hn::IfThenElseZero(for_uints(is_point), number), is_point, middle};
}
HWY_INLINE Target target_drawn(const Lights& lights, Vectors x, Uints lamp,
                               const LightSamples& light) {
  return target_at(lights, x, light.direction, lamp,
                   hn::IfThenElse(light.dense(), set(kInfinity), light.distance));
}
// From their columns. A lobe asks no density of the plane of a lamp.
template <typename SentRays>
HWY_INLINE Target target_of(const Wavefront& wavefront, const SentRays& refracted, size_t i) {
  const Uints lamp = load(refracted.lamp, i);
  const Vectors place = load(refracted.target, i);
  LampMiddle middle{};
  if (!wavefront.boundary_is_delta) {
    middle = {hn::Sqrt(dot(place, place)), normalize(place)};
  } else if (wavefront.scene.lights.has_lamps()) {
    middle = seen_middle(wavefront.scene.lights, lamp, load(refracted.origin, i));
  }
  return {place, lamp, not_zero(lamp), middle};
}

// How rays were sent first that have searched in vain.
template <typename SentRays>
HWY_INLINE Aim first_aim_of(const Wavefront& wavefront, const SentRays& refracted, size_t i,
                            Uints medium, Mask where) {
  const Vectors x = if_then_else(where, load(refracted.origin, i), set(Vec3f{}));
  return first_aim(wavefront, medium, x, target_of(wavefront, refracted, i).direction());
}

HWY_INLINE Vectors scattered_at(const Paths& paths, size_t i) {
  const auto& at = paths.scattered_at;
  return {load(at[0], i), load(at[1], i), load(at[2], i)};
}

// The part of light that arrives when it goes so far in a medium.
HWY_INLINE Floats part_arriving(const Wavefront& wavefront, Uints medium, Floats length) {
  return exp(-(length * sigma_t_of(wavefront.media, medium)));
}

// The density of the lobe around a direction.
HWY_INLINE Floats lobe_pdf(const Wavefront& wavefront, Uints medium, Vectors axis,
                           Vectors direction) {
  const Vectors off = direction - axis;
  return by_medium(wavefront.media, medium,
                   [&](const Medium& of) { return density(of.refraction.lobe, dot(off, off)); });
}
HWY_INLINE Vectors draw_in_lobe(const Wavefront& wavefront, Uints medium, Vectors axis,
                                const Words& words) {
  const Floats u = uniform(words.w[1]);
  const Floats t = by_medium(wavefront.media, medium,
                             [&](const Medium& of) { return sample_lobe(of.refraction.lobe, u); });
  const Floats cosine = 1 - 0.5F * t;
  const Floats sine2 = t * (1 - 0.25F * t);
  const Floats sine = hn::Sqrt(hn::Max(hn::Zero(FloatTag()), sine2));
  const SinCos phi = sin_cos_2pi(uniform(words.w[2]));
  return renormalize(frame_to_world(axis, sine * phi.cos, sine * phi.sin, cosine));
}

// How far rays go that search for a facet, in mm. The roulette does not shorten them: it judges the
// ray that is aimed at what they find, which may be much shorter.
HWY_INLINE Floats longest_search(const Wavefront& wavefront, Uints medium) {
  return by_medium(wavefront.media, medium,
                   [](const Medium& of) { return set(kMaxOpticalDepth / of.sigma_t); });
}
// A distance from x within which there is no boundary, in mm: that of the depth grid, as short as
// its cells and its steps may make it.
HWY_INLINE Floats least_depth(const Wavefront& wavefront, Vectors x) {
  constexpr float kLongestStep = 1.1F, kMiddles = 1.74F;  // two half diagonals of a cell
  const DepthGrid& depth_grid = wavefront.scene.obstacles.depth_grid;
  const Floats thirds = quantized_depth(depth_grid, cells_at(depth_grid.cells, x));
  const auto edge = static_cast<float>(depth_grid.cells.edge);
  return mul_add(thirds, set(edge / (3 * kLongestStep)), set(-kMiddles * edge));
}

// One over the density with which the walk went from where it scattered to a rough boundary, for
// paths in slots i, i + 1 ...; 0 for others.
HWY_INLINE Floats per_arrival(const Wavefront& wavefront, size_t i, Uints medium) {
  const Floats zero = hn::Zero(FloatTag()), walk_pdf = load(wavefront.paths.scattered_pdf[0], i);
  const Mask scattered = walk_pdf > 0;
  if (hn::AllFalse(FloatTag(), scattered)) return zero;
  const Floats arriving =
      part_arriving(wavefront, medium, load(wavefront.paths.rays.medium_length, i));
  return hn::IfThenElseZero(scattered, 1 / (walk_pdf * arriving));
}
// The odds there for light in the direction `to_light`, as it is seen from where they scattered.
HWY_INLINE Floats refraction_odds(const Wavefront& wavefront, size_t i, Uints medium,
                                  Vectors to_light) {
  const Floats per = per_arrival(wavefront, i, medium);
  if (hn::AllFalse(FloatTag(), per > 0)) return per;
  const Aim aim =
      aim_at(plane_ahead(wavefront, medium, scattered_at(wavefront.paths, i), to_light), to_light);
  const Floats pdf =
      lobe_pdf(wavefront, medium, aim.direction, load(wavefront.paths.rays.direction, i));
  return hn::IfThenElseZero(aim.possible, per * pdf);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
