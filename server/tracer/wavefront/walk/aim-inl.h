// Finds where to aim from a place inside a smooth boundary, so that it refracts what goes there to
// a light.
#if defined(ITN_TRACER_WAVEFRONT_WALK_AIM_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_AIM_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_AIM_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_AIM_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include "server/tracer/boundary/fresnel-inl.h"
#include "server/tracer/geometry/obstacles.h"
#include "server/tracer/lights/lights-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The largest density; more is none.
constexpr float kMostDensity = 1e30F;

// A smooth plane between the media.
struct Plane {
  Vectors normal;  // outwards
  Floats index;    // of the medium, relative to what is around it
};

// What the plane refracts the direction of a path to, which goes outwards: from `outer` to inside,
// or from `inner` to outside.
struct Aim {
  Vectors direction;
  Mask possible;
  Floats inner_by_outer;  // density of `inner` over that of `outer`
};
HWY_INLINE Floats inner_by_outer(const Plane& plane, Floats inner_cosine, Floats outer_cosine) {
  const Floats least = set(1e-4F);  // along the plane
  return plane.index * plane.index * inner_cosine / hn::Max(outer_cosine, least);
}
HWY_INLINE Aim aim_at(const Plane& plane, Vectors outer) {
  const Floats zero = hn::Zero(FloatTag()), index = plane.index;
  const Vectors none{zero, zero, zero};
  const Floats facing = dot(plane.normal, outer), cosine = hn::Max(facing, zero);
  const Floats inner_cosine = fresnel(cosine, index).refracted_cosine;
  return {none - refracted(none - outer, plane.normal, cosine, inner_cosine, index), facing > 0,
          inner_by_outer(plane, inner_cosine, cosine)};
}
HWY_INLINE Aim aim_along(const Plane& plane, Vectors inner) {
  const Floats zero = hn::Zero(FloatTag()), index = 1 / plane.index;
  const Vectors none{zero, zero, zero};
  const Floats facing = dot(plane.normal, inner), cosine = hn::Max(facing, zero);
  const Floats outer_cosine = fresnel(cosine, index).refracted_cosine;
  return {refracted(inner, none - plane.normal, cosine, outer_cosine, index),
          (facing > 0) & (outer_cosine > 0), inner_by_outer(plane, cosine, outer_cosine)};
}

// The middle of a lamp, as it is seen from somewhere: how far, and in which direction.
struct LampMiddle {
  Floats distance;
  Vectors direction;
};
HWY_INLINE LampMiddle seen_middle(const Lights& lights, Uints lamp, Vectors from) {
  const Vectors to = middle_of(lights, lamp) - from;
  const Floats distance = hn::Max(hn::Sqrt(dot(to, to)), set(1e-20F));
  return {distance, to * (1 / distance)};
}

// How far it is in direction d to the plane across the middle, from a place `at` beside that where
// it is seen from; or infinite, if the plane is not ahead, or hardly.
HWY_INLINE Floats way_to_plane(const LampMiddle& middle, Vectors at, Vectors d) {
  const Floats cosine = dot(d, middle.direction);
  const Floats way = (middle.distance - dot(at, middle.direction)) / cosine;
  const Mask ahead = (cosine > 0.1F) & (way > 0);
  return hn::IfThenElse(ahead, way, set(kInfinity));
}

// What a ray from x is for: what is far away in a direction, or a point, which is in the plane
// across the middle of a lamp.
constexpr uint32_t kPointLight = ~0U;
struct Target {
  Vectors place;  // the direction, or the way from x to the point
  Uints lamp;     // its number, or kPointLight; 0: what is far away
  Mask is_point;
  LampMiddle middle;

  HWY_INLINE Vectors direction() const { return if_then_else(is_point, normalize(place), place); }
};

HWY_INLINE Target far_target(Vectors direction) {
  return {direction, hn::Zero(UintTag()), hn::FirstN(FloatTag(), 0), LampMiddle{}};
}

// A solid angle at x over the area in the plane of a lamp, `to_point` from x, across a direction
// `outer` that light takes there: of what goes straight.
HWY_INLINE Floats straight_by_area(const LampMiddle& middle, Vectors to_point, Vectors outer) {
  const Floats d2 = dot(to_point, to_point);
  return dot(to_point, middle.direction) / (d2 * hn::Sqrt(d2) * dot(outer, middle.direction));
}

// How the plane refracts what goes from x to a point `to_point` from there, in that plane of a
// lamp: `inner` and `outer` are directions, of which the first goes `near` to the plane, and the
// second `far` from there. The density is over that of the straight direction to the point: light
// spreads from x as if it came from two places, one across the plane of refraction and one in it.
HWY_INLINE Floats inner_by_straight(const Plane& plane, const LampMiddle& middle, Vectors to_point,
                                    Vectors inner, Vectors outer, Floats near, Floats far) {
  const Floats inner_cosine = dot(plane.normal, inner), outer_cosine = dot(plane.normal, outer);
  const Floats across = near / plane.index, ratio = outer_cosine / inner_cosine;
  const Floats area = (far + across) * mul_add(ratio * ratio, across, far);
  return inner_by_outer(plane, inner_cosine, outer_cosine) *
         (area * straight_by_area(middle, to_point, outer));
}

// Aims as aim_at does, from a place so deep below the plane to a point; the density is over that of
// the straight direction.
HWY_INLINE Aim aim_at_point(const Plane& plane, const LampMiddle& middle, Floats depth,
                            Vectors to_point) {
  const Floats one = set(1.0F);
  const Floats along = dot(to_point, plane.normal), height = along - depth;
  const Vectors beside = to_point - plane.normal * along;
  const Floats width = hn::Sqrt(dot(beside, beside));
  const Floats index2 = plane.index * plane.index;
  // For the tangent of the outer angle, height t + depth t / sqrt(index^2 + (index^2 - 1) t^2) is
  // the width. The left side is concave, so Newton's method comes up from below without fail.
  Floats t = width / (height + depth / plane.index);
  constexpr int kSteps = 4;
  for (int step = 0; step < kSteps; ++step) {
    const Floats root = hn::Sqrt(mul_add(index2 - 1, t * t, index2));
    const Floats inside = depth / root;
    const Floats left = width - t * (height + inside);
    const Floats slope = mul_add(inside, index2 / (root * root), height);
    t += left / slope;
  }
  const Floats outer_cosine = 1 / hn::Sqrt(mul_add(t, t, one));
  const Floats outer_sine = t * outer_cosine;
  const Floats inner_sine = outer_sine / plane.index;
  const Floats inner_cosine = hn::Sqrt(1 - inner_sine * inner_sine);
  const Vectors sideways = beside * (1 / hn::Max(width, set(1e-20F)));
  const Vectors inner = renormalize(plane.normal * inner_cosine + sideways * inner_sine);
  const Vectors outer = plane.normal * outer_cosine + sideways * outer_sine;
  const Floats near = depth / inner_cosine;
  const Mask between = (depth > 0) & (height > 0);
  const Floats far = way_to_plane(middle, inner * near, outer);
  return {inner, between & (far < kInfinity),
          inner_by_straight(plane, middle, to_point, inner, outer, near, far)};
}

// A triangle that stands for a smooth surface, as it is seen from x; the normals are of that.
struct CurvedFacet {
  Vectors to_corner, normal, v, w;                  // see Facets::Facet
  Vectors corner_normal, normal_by_v, normal_by_w;  // interpolated, of any length
};
HWY_INLINE Vectors load_vectors(const float* from, Ints at) {
  return {hn::GatherIndex(FloatTag(), from, at), hn::GatherIndex(FloatTag(), from + 1, at),
          hn::GatherIndex(FloatTag(), from + 2, at)};
}
// In numbers: where the facet, and its normals at the corners, begin in their lists.
HWY_INLINE Ints numbers_of(Ints facet, size_t bytes) {
  return facet * hn::Set(IntTag(), static_cast<int32_t>(bytes / sizeof(float)));
}
HWY_INLINE CurvedFacet curved_facet(const Obstacles& obstacles, Ints facet, Vectors x) {
  const auto* const numbers = reinterpret_cast<const float*>(obstacles.facets.by_triangle.data());
  const auto* const corners =
      reinterpret_cast<const float*>(obstacles.corner_normals.by_triangle().data());
  const Ints facet_begin = numbers_of(facet, sizeof(Facets::Facet));
  const Ints normals = numbers_of(facet, 3 * sizeof(Vec3f));
  const Vectors first = load_vectors(corners, normals);
  return {load_vectors(numbers, facet_begin) - x,
          load_vectors(numbers + 3, facet_begin),
          load_vectors(numbers + 6, facet_begin),
          load_vectors(numbers + 9, facet_begin),
          first,
          load_vectors(corners + 3, normals) - first,
          load_vectors(corners + 6, normals) - first};
}
HWY_INLINE Mask is_within(Floats v, Floats w) {
  return (v >= 0) & (w >= 0) & (v + w <= 1);
}

// Light that goes from x to a place of the facet, and on: `index` times the direction inside less
// that outside is along the normal where Snell's law holds, and it is `off` that, in the surface.
struct Bend {
  Vectors normal, inner, outer;
  Floats near, along, per_length;
  Vectors off;
};
HWY_INLINE Bend bend_at(const CurvedFacet& facet, Floats index, Vectors to_place,
                        const Target& target) {
  const Vectors place = to_place - facet.to_corner;
  const Vectors sum = facet.corner_normal + facet.normal_by_v * dot(place, facet.v) +
                      facet.normal_by_w * dot(place, facet.w);
  const Floats per_length = 1 / hn::Sqrt(dot(sum, sum));
  const Floats near = hn::Sqrt(dot(to_place, to_place));
  const Vectors inner = to_place * (1 / near);
  const Vectors outer =
      if_then_else(target.is_point, normalize(target.place - to_place), target.place);
  const Vectors normal = sum * per_length, both = inner * index - outer;
  const Floats along = dot(both, normal);
  return {normal, inner, outer, near, along, per_length, both - normal * along};
}
// How `off` changes by the way that the place goes in the triangle, while the direction outside
// stays what it is.
HWY_INLINE Vectors change_of_off(const CurvedFacet& facet, const Bend& bend, Floats index,
                                 Vectors way) {
  const Vectors turn = (way - bend.inner * dot(way, bend.inner)) * (index / bend.near);
  const Vectors normal_turn =
      (facet.normal_by_v * dot(way, facet.v) + facet.normal_by_w * dot(way, facet.w)) *
      (bend.per_length * bend.along);
  const Vectors both = turn - normal_turn;
  return both - bend.normal * dot(both, bend.normal);
}
// Two directions in a triangle, of unit length and at right angles.
struct Sides {
  Vectors a, b;
};
HWY_INLINE Sides sides_of(const CurvedFacet& facet) {
  const Vectors a = normalize(facet.v);
  return {a, cross(facet.normal, a)};
}

// The factor inner_by_outer, or to a lamp inner_by_straight, where Snell's law holds.
HWY_INLINE Floats inner_by_drawn(const CurvedFacet& facet, const Bend& bend, Floats index,
                                 const Target& target, Floats far) {
  const Sides sides = sides_of(facet);
  const Vectors by_a = change_of_off(facet, bend, index, sides.a);
  const Vectors by_b = change_of_off(facet, bend, index, sides.b);
  const Floats outer_cosine = dot(bend.outer, bend.normal);
  const Floats inner_by_place = bend.near * bend.near / dot(bend.inner, facet.normal);
  const Floats directions = dot(bend.normal, cross(by_a, by_b)) / outer_cosine;
  // The light turns by what Snell's law asks for, and stays of unit length.
  const auto moved = [&](Vectors way, Vectors turn) {
    const Floats up = dot(bend.outer, turn) / outer_cosine;
    return way + (turn - bend.normal * up) * far;
  };
  const Floats area = dot(bend.outer, cross(moved(sides.a, by_a), moved(sides.b, by_b)));
  const Floats density =
      hn::IfThenElse(target.is_point,
                     area * straight_by_area(target.middle, target.place, bend.outer), directions);
  return hn::Abs(density) * inner_by_place;
}

// A place where a facet refracts what goes there to a target.
struct Place {
  Vectors to;  // from x
  Mask possible;
};

// By Newton's method from where the plane of the facet would refract it.
HWY_INLINE Place place_on_curved(const CurvedFacet& facet, Floats index, const Target& target) {
  constexpr int kSteps = 3;
  constexpr float kConverged = 2e-5F;
  const Sides sides = sides_of(facet);
  const Plane plane{facet.normal, index};
  const Floats depth = dot(facet.to_corner, facet.normal);
  const Aim start = aim_at(plane, target.direction());
  Vectors to_place = start.direction * (depth / dot(start.direction, facet.normal));
  Bend bend = bend_at(facet, index, to_place, target);
  for (int step = 0; step < kSteps; ++step) {
    const Vectors rest = target.place - to_place;
    const Floats per_far = hn::IfThenElseZero(target.is_point, 1 / hn::Sqrt(dot(rest, rest)));
    const auto change = [&](Vectors way) {
      const Vectors turn = (way - bend.outer * dot(way, bend.outer)) * per_far;
      return change_of_off(facet, bend, index, way) + turn - bend.normal * dot(turn, bend.normal);
    };
    const Vectors by_a = change(sides.a), by_b = change(sides.b);
    const Floats per = 1 / dot(bend.normal, cross(by_a, by_b));
    const Floats a = dot(bend.normal, cross(by_b, bend.off)) * per;
    const Floats b = dot(bend.normal, cross(bend.off, by_a)) * per;
    to_place = to_place + sides.a * a + sides.b * b;
    bend = bend_at(facet, index, to_place, target);
  }
  const Floats far =
      hn::IfThenElseZero(target.is_point, way_to_plane(target.middle, to_place, bend.outer));
  const Vectors place = to_place - facet.to_corner;
  Mask possible =
      start.possible & (depth > 0) & is_within(dot(place, facet.v), dot(place, facet.w));
  possible &= dot(bend.off, bend.off) < kConverged * kConverged;
  for (const Vectors& normal : {bend.normal, facet.normal}) {
    possible &= (dot(bend.inner, normal) > 0) & (dot(bend.outer, normal) > 0);
  }
  return {to_place, possible & (far < kInfinity)};
}

// A facet that is flat, as it is seen from x.
struct FlatFacet {
  Vectors to_corner, v, w;  // see Facets::Facet
  Plane plane;
  Floats depth;  // of x below it
};
HWY_INLINE FlatFacet flat_facet(const Facets& facets, Ints facet, Floats index, Vectors x) {
  const auto* const numbers = reinterpret_cast<const float*>(facets.by_triangle.data());
  const Ints at = numbers_of(facet, sizeof(Facets::Facet));
  const Vectors to_corner = load_vectors(numbers, at) - x, normal = load_vectors(numbers + 3, at);
  return {to_corner,
          load_vectors(numbers + 6, at),
          load_vectors(numbers + 9, at),
          {normal, index},
          dot(to_corner, normal)};
}
// Aims as aim_at and aim_at_point do.
HWY_INLINE Aim aim_at_flat(const FlatFacet& facet, const Target& target) {
  const Aim aim = aim_at(facet.plane, target.place);
  const Mask is_point = target.is_point;
  if (hn::AllFalse(FloatTag(), is_point)) return aim;
  const Aim point = aim_at_point(facet.plane, target.middle, facet.depth, target.place);
  return {if_then_else(is_point, point.direction, aim.direction),
          (is_point & point.possible) | hn::AndNot(is_point, aim.possible),
          hn::IfThenElse(is_point, point.inner_by_outer, aim.inner_by_outer)};
}
HWY_INLINE Place place_on_flat(const FlatFacet& facet, const Target& target) {
  const Aim aim = aim_at_flat(facet, target);
  const Vectors to = aim.direction * (facet.depth / dot(aim.direction, facet.plane.normal));
  const Vectors place = to - facet.to_corner;
  const Mask within = is_within(dot(place, facet.v), dot(place, facet.w));
  return {to, aim.possible & within & (facet.depth > 0)};
}

// The same of facets that are flat or curved, by number; to aim, the place is known.
HWY_INLINE Place place_on(const Obstacles& obstacles, Ints facet, Floats index, Vectors x,
                          const Target& target) {
  return obstacles.corner_normals.flat()
             ? place_on_flat(flat_facet(obstacles.facets, facet, index, x), target)
             : place_on_curved(curved_facet(obstacles, facet, x), index, target);
}
HWY_INLINE Aim aim_at_place(const Obstacles& obstacles, Ints facet, Floats index, Vectors x,
                            const Target& target, Vectors to_place) {
  if (obstacles.corner_normals.flat())
    return aim_at_flat(flat_facet(obstacles.facets, facet, index, x), target);
  const CurvedFacet curved = curved_facet(obstacles, facet, x);
  const Bend bend = bend_at(curved, index, to_place, target);
  const Floats far =
      hn::IfThenElseZero(target.is_point, way_to_plane(target.middle, to_place, bend.outer));
  return {bend.inner, hn::FirstN(FloatTag(), lanes()),
          inner_by_drawn(curved, bend, index, target, far)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
