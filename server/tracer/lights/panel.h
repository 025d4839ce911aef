// A lamp that is a parallelogram and shines to one side, of the same radiance from everywhere
// there. Its other side is black.
#ifndef ITN_TRACER_LIGHTS_PANEL_H_
#define ITN_TRACER_LIGHTS_PANEL_H_

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/error.h"
#include "common/vec.h"
#include "server/tracer/lights/lamp.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

// What is rendered, in the coordinates of the object.
struct PanelLamp {
  Vec3d center, half_u, half_v;
  double radiance;
  double distance2;  // see LampPlace
  Vec3d normal;      // of the side that shines
  // A place from the center is within the panel if its products with both are in [-1, 1].
  Vec3d across_u, across_v;
  double touch;       // what is nearer to its plane touches it, in mm
  bool is_rectangle;  // to the precision of floats

  static constexpr const char* kName = "panel";
  bool cuts(const Mesh& mesh, const Bounds& box) const {
    return crosses(mesh, box, center, half_u, half_v);
  }

  static constexpr bool kDelta = false, kDistant = false;
  double area() const { return 4 * length(cross(half_u, half_v)); }
  // Irradiance at the object's middle if the panel faced it; that of a half-space of light at most.
  double power() const { return radiance * std::min(area() / distance2, std::numbers::pi); }
};

struct PanelLight {
  Vec3d center;          // outside of the medium
  Vec3d half_u, half_v;  // edges, halved
  double radiance = 1;   // W/(m^2 sr), to the side of cross(half_u, half_v)

  static constexpr const char* kName = PanelLamp::kName;
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.moving_position("center", self.center);
    to.position("half_u", self.half_u);
    to.position("half_v", self.half_v);
    to.number("radiance", self.radiance, 0, 1e9);
  }
  PanelLamp compile(const LightFrame& frame) const {
    const LampPlace place = lamp_place(frame, "panel.center", center);
    const auto turned = frame.pose.rotation.inverse();
    const Vec3d u = turned(half_u), v = turned(half_v);
    const Vec3d n = cross(u, v);
    if (!(length(n) > 0)) {
      throw invalid_input("panel.half_u is parallel to half_v, or one of them is 0");
    }
    return {place.position,
            u,
            v,
            radiance,
            place.distance2,
            itn::normalize(n),
            cross(v, n) * (1 / dot(n, n)),
            cross(n, u) * (1 / dot(n, n)),
            place.rounding,
            std::abs(dot(u, v)) <= 1e-6 * length(u) * length(v)};
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_PANEL_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_PANEL_MATHS_
#undef ITN_TRACER_LIGHTS_PANEL_MATHS_
#else
#define ITN_TRACER_LIGHTS_PANEL_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// A rectangle as it is seen from places: its edges there along half_u and half_v, from x0 to x1 and
// from y0 to y1, at a distance z from its plane.
//
// The part of it between the edge x0 and a place x on it is seen in the solid angle
//   F(x, y1) - F(x, y0) - F(x0, y1) + F(x0, y0),   F(x, y) = atan(x y / (z sqrt(x^2 + y^2 + z^2))),
// which for F = asin(x' y'), x' = x / sqrt(x^2 + z^2) and so on, can be solved for x. On the line
// at x, directions are as likely as the sine of their angle with it from the middle grows evenly.
// After Urena, Fajardo, King, "An area-preserving parametrization for spherical rectangles", EGSR
// 2013. Where the angle is small, floats do not tell it: by area then, as all parallelograms are.
struct SeenPanel {
  Vectors to_center;
  Floats x0, x1, y0, y1, z;
  Floats begin, turns;  // F(x0, y1) - F(x0, y0), and the solid angle, over 2 pi
  Mask by_angle;
};
HWY_INLINE Floats corner_turns(const SeenPanel& seen, Floats x, Floats y) {
  const Floats xy = x * y;
  const Floats r2 = mul_add(x, x, mul_add(y, y, seen.z * seen.z));
  return hn::CopySign(atan2_turns(hn::Abs(xy), seen.z * hn::Sqrt(r2)), xy);
}
HWY_INLINE Floats turns_at(const SeenPanel& seen, Floats x) {
  return corner_turns(seen, x, seen.y1) - corner_turns(seen, x, seen.y0);
}
// To its middle. Of an object that stands on it, rounding puts places on either side of its plane:
// they are a little in front of it, or `behind`.
HWY_INLINE Vectors to_center_of(const PanelLamp& light, Vectors from, Mask behind) {
  const Vectors straight = set(static_cast<Vec3f>(light.center)) - from;
  const Vectors normal = set(static_cast<Vec3f>(light.normal));
  const Floats along = dot(normal, straight), touch = set(static_cast<float>(light.touch));
  const Floats by = hn::IfThenElse(behind, touch, -touch) - along;
  return if_then_else(hn::Abs(along) < touch, straight + normal * by, straight);
}
HWY_INLINE SeenPanel seen_panel(const PanelLamp& light, Vectors from,
                                Mask behind = hn::FirstN(FloatTag(), 0)) {
  constexpr float kLeastTurns = 0.01F;
  const Vectors to_center = to_center_of(light, from, behind);
  SeenPanel seen;
  seen.to_center = to_center;
  const auto edges = [&](Vec3d half, Floats& low, Floats& high) {
    const Floats middle = dot(to_center, set(static_cast<Vec3f>(itn::normalize(half))));
    const Floats reach = set(static_cast<float>(length(half)));
    low = middle - reach;
    high = middle + reach;
  };
  edges(light.half_u, seen.x0, seen.x1);
  edges(light.half_v, seen.y0, seen.y1);
  seen.z = hn::Max(hn::Abs(dot(to_center, set(static_cast<Vec3f>(light.normal)))), set(1e-20F));
  seen.begin = turns_at(seen, seen.x0);
  seen.turns = turns_at(seen, seen.x1) - seen.begin;
  seen.by_angle = seen.turns > (light.is_rectangle ? kLeastTurns : kInfinity);
  return seen;
}

// What a place of it is drawn by, two uniform numbers, and conversely; a place as parts of the
// edges, from 0 to 1.
struct PanelPlace {
  Floats u, v;
};
HWY_INLINE Floats line_sine(Floats y, Floats d2) {
  return y / hn::Sqrt(mul_add(y, y, d2));
}
HWY_INLINE PanelPlace place_of(const SeenPanel& seen, PanelPlace numbers) {
  const Floats one = set(1.0F), zero = hn::Zero(FloatTag()), z2 = seen.z * seen.z;
  const auto part_of = [&](Floats at, Floats low, Floats high) {
    return hn::Clamp((at - low) / (high - low), zero, one);
  };
  // asin(x' y1') - asin(x' y0') = q.
  const SinCos q = sin_cos_2pi(mul_add(numbers.u, seen.turns, seen.begin));
  const Floats s0 = line_sine(seen.y0, z2), s1 = line_sine(seen.y1, z2), apart = s1 - s0;
  const Floats twice = (s0 + s0) * s1;
  const Floats squared = mul_add(apart, apart, twice * (1 - q.cos));
  const Floats sine = q.sin / hn::Sqrt(hn::Max(squared, set(1e-20F)));
  const Floats cosine2 = hn::Max(1 - sine * sine, set(1e-12F));
  const Floats x = hn::Clamp(sine * seen.z / hn::Sqrt(cosine2), seen.x0, seen.x1);
  const Floats d2 = mul_add(x, x, z2);
  const Floats h = mix(line_sine(seen.y0, d2), line_sine(seen.y1, d2), numbers.v);
  const Floats rest2 = hn::Max(1 - h * h, set(1e-12F));
  const Floats y = h * hn::Sqrt(d2 / rest2);
  return {hn::IfThenElse(seen.by_angle, part_of(x, seen.x0, seen.x1), numbers.u),
          hn::IfThenElse(seen.by_angle, part_of(y, seen.y0, seen.y1), numbers.v)};
}
HWY_INLINE PanelPlace numbers_of(const SeenPanel& seen, PanelPlace place) {
  const Floats x = mix(seen.x0, seen.x1, place.u), y = mix(seen.y0, seen.y1, place.v);
  const Floats d2 = mul_add(x, x, seen.z * seen.z);
  const Floats h0 = line_sine(seen.y0, d2), h1 = line_sine(seen.y1, d2);
  const Floats u = (turns_at(seen, x) - seen.begin) / seen.turns;
  const Floats v = (line_sine(y, d2) - h0) / (h1 - h0);
  return {hn::IfThenElse(seen.by_angle, u, place.u), hn::IfThenElse(seen.by_angle, v, place.v)};
}

// Along a unit direction, at a distance from its front or back.
HWY_INLINE Appearance appearance_of(const PanelLamp& light, const SeenPanel& seen, Floats facing,
                                    Floats distance) {
  const Floats by_area = hn::Abs(facing) * static_cast<float>(light.area());
  const Floats per_area = distance * distance / hn::Max(by_area, set(1e-30F));
  const Floats per_angle = 0.5F * std::numbers::inv_pi_v<float> / seen.turns;
  return {distance,
          {hn::IfThenElseZero(facing < 0, set(static_cast<float>(light.radiance))),
           hn::IfThenElse(seen.by_angle, per_angle, per_area)}};
}

HWY_INLINE Vectors to_place(const PanelLamp& light, const SeenPanel& seen, PanelPlace place) {
  const auto along = [](Floats v) { return v + v - 1; };
  return seen.to_center + set(static_cast<Vec3f>(light.half_u)) * along(place.u) +
         set(static_cast<Vec3f>(light.half_v)) * along(place.v);
}

HWY_INLINE LampDraw draw(const PanelLamp& light, Vectors from, const LightUniforms& u) {
  const SeenPanel seen = seen_panel(light, from);
  const Vectors to = to_place(light, seen, place_of(seen, {u.u0, u.u1}));
  const Floats distance = hn::Sqrt(hn::Max(dot(to, to), set(1e-20F)));
  const Vectors direction = to * (1 / distance);
  const Floats facing = dot(direction, set(static_cast<Vec3f>(light.normal)));
  return {direction, appearance_of(light, seen, facing, distance)};
}

HWY_INLINE Appearance look(const PanelLamp& light, Vectors from, Vectors d) {
  const Vectors normal = set(static_cast<Vec3f>(light.normal));
  const Floats facing = dot(normal, d);
  const SeenPanel seen = seen_panel(light, from, facing > 0);
  const Floats t = dot(normal, seen.to_center) / facing;
  const Vectors place = d * t - seen.to_center;
  const auto within = [&](Vec3d across) {
    return hn::Abs(dot(place, set(static_cast<Vec3f>(across)))) <= 1;
  };
  const Mask met = (t > 0) & within(light.across_u) & within(light.across_v);
  return where(met, appearance_of(light, seen, facing, t));
}

HWY_INLINE Vectors redraw(const PanelLamp& light, Vectors from, Vectors d, Vectors other) {
  const SeenPanel here = seen_panel(light, from), there = seen_panel(light, other);
  const Vectors place = d * look(light, from, d).distance - here.to_center;
  const auto part = [&](Vec3d across) {
    const Floats half = set(0.5F);
    return mul_add(dot(place, set(static_cast<Vec3f>(across))), half, half);
  };
  const PanelPlace numbers = numbers_of(here, {part(light.across_u), part(light.across_v)});
  return normalize(to_place(light, there, place_of(there, numbers)));
}

// Each piece of an edge along t that goes by m sweeps m.(d x t) by length, over the square of its
// distance.
HWY_INLINE Outline outline(const PanelLamp& light, Vectors from, Floats u, bool opposite) {
  const double length_u = length(light.half_u), length_v = length(light.half_v);
  const Floats place = u * static_cast<float>(length_u + length_v);
  const Mask along_u = place < static_cast<float>(length_u);
  const Vectors half_u = set(static_cast<Vec3f>(light.half_u));
  const Vectors half_v = set(static_cast<Vec3f>(light.half_v));
  const auto along = [&](Floats part) { return part + part - 1; };
  const Floats on_u = along(place * static_cast<float>(1 / length_u));
  const Floats on_v =
      along((place - static_cast<float>(length_u)) * static_cast<float>(1 / length_v));
  const Floats side = set(opposite ? -1.0F : 1.0F);
  const Vectors outwards = if_then_else(along_u, half_v, half_u) * side;
  const Vectors edge = if_then_else(along_u, half_u * set(static_cast<float>(1 / length_u)),
                                    half_v * set(static_cast<float>(1 / length_v)));
  const Vectors to = to_center_of(light, from, hn::FirstN(FloatTag(), 0)) + outwards +
                     if_then_else(along_u, half_u * on_u, half_v * on_v) * side;
  const Floats d2 = hn::Max(dot(to, to), set(1e-20F)), distance = hn::Sqrt(d2);
  const Vectors direction = to * (1 / distance), swept = cross(direction, edge);
  const auto around = static_cast<float>(2 * (length_u + length_v));
  const Floats by = hn::CopySign(around / d2, dot(swept, outwards));
  const Mask shines = dot(direction, set(static_cast<Vec3f>(light.normal))) < 0;
  return {direction, distance, swept * by,
          hn::IfThenElseZero(shines, set(static_cast<float>(light.radiance)))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
