// A lamp that is a ball, of the same radiance from everywhere.
#ifndef ITN_TRACER_LIGHTS_SPHERE_H_
#define ITN_TRACER_LIGHTS_SPHERE_H_

#include <cmath>
#include <numbers>

#include "common/error.h"
#include "common/vec.h"
#include "server/tracer/lights/lamp.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

// What is rendered, in the coordinates of the object.
struct SphereLamp {
  Vec3d center;
  double radius;
  double radiance;
  double distance2;  // see LampPlace

  static constexpr const char* kName = "sphere";
  bool cuts(const Mesh& mesh, const Bounds& box) const {
    return is_in_ball(mesh, box, center, radius);
  }

  static constexpr bool kDelta = false, kDistant = false;
  double power() const { return std::numbers::pi * radiance * radius * radius / distance2; }
};

struct SphereLight {
  Vec3d center;         // outside of the medium
  double radius = 1;    // mm
  double radiance = 1;  // W/(m^2 sr)

  static constexpr const char* kName = SphereLamp::kName;
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.moving_position("center", self.center);
    to.number("radius", self.radius, 1e-6, 1e6);
    to.number("radiance", self.radiance, 0, 1e9);
  }
  SphereLamp compile(const LightFrame& frame) const {
    const LampPlace place = lamp_place(frame, "sphere.center", center);
    if (!(radius * radius < place.distance2)) {
      throw invalid_input("sphere.radius: the object is in the lamp; it must stand outside of it");
    }
    return {place.position, radius, radiance, place.distance2};
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_SPHERE_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_SPHERE_MATHS_
#undef ITN_TRACER_LIGHTS_SPHERE_MATHS_
#else
#define ITN_TRACER_LIGHTS_SPHERE_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The cone that it is seen in; from inside of it, half of all directions.
struct Cone {
  Vectors axis;  // of unit length
  Mask outside;
  Floats size;  // 1 - cos of its half angle
};
HWY_INLINE Cone cone_of(const SphereLamp& light, Vectors to_center) {
  const Floats one = set(1.0F);
  const auto radius2 = static_cast<float>(light.radius * light.radius);
  const Floats d2 = dot(to_center, to_center);
  const Mask outside = d2 > radius2;
  const Floats sine2 = hn::IfThenElse(outside, radius2 / d2, one);
  return {to_center * (1 / hn::Max(hn::Sqrt(d2), set(1e-20F))), outside,
          sine2 / (1 + hn::Sqrt(1 - sine2))};
}

// In a cone, z = 1 - cos_theta as part of its size, and around its axis.
HWY_INLINE Vectors in_cone(const Cone& cone, Floats part, Floats cos_phi, Floats sin_phi) {
  const Floats z = part * cone.size;
  const Floats sine = hn::Sqrt(z * (2 - z));
  return renormalize(frame_to_world(cone.axis, sine * cos_phi, sine * sin_phi, 1 - z));
}

// How it is seen through the cone, from where its middle and half of its chord are so far away.
HWY_INLINE Appearance appearance_of(const SphereLamp& light, const Cone& cone, Floats middle,
                                    Floats half_chord) {
  const Floats near_end = middle - half_chord, far_end = middle + half_chord;
  return {hn::Max(hn::IfThenElse(cone.outside, near_end, far_end), hn::Zero(FloatTag())),
          {hn::IfThenElseZero(cone.outside, set(static_cast<float>(light.radiance))),
           0.5F * std::numbers::inv_pi_v<float> / cone.size}};
}
HWY_INLINE Floats half_chord2(const SphereLamp& light, Floats off2) {
  return static_cast<float>(light.radius * light.radius) - off2;
}

// In the cone, all directions alike: z is uniform, as that of a sun (sun_disc.h).
HWY_INLINE LampDraw draw(const SphereLamp& light, Vectors from, const LightUniforms& u) {
  const Vectors to_center = set(static_cast<Vec3f>(light.center)) - from;
  const Cone cone = cone_of(light, to_center);
  const SinCos phi = sin_cos_2pi(u.u1);
  const Floats z = u.u0 * cone.size, zero = hn::Zero(FloatTag());
  const Floats d2 = dot(to_center, to_center);
  const Floats off2 = z * (2 - z) * d2;
  const Floats middle = hn::Sqrt(d2) * (1 - z);
  return {in_cone(cone, u.u0, phi.cos, phi.sin),
          appearance_of(light, cone, middle, hn::Sqrt(hn::Max(half_chord2(light, off2), zero)))};
}

// What is drawn from inside of it is half of what is met there; it is dark there.
HWY_INLINE Appearance look(const SphereLamp& light, Vectors from, Vectors d) {
  const Floats zero = hn::Zero(FloatTag());
  const Vectors to_center = set(static_cast<Vec3f>(light.center)) - from;
  const Cone cone = cone_of(light, to_center);
  const Floats middle = dot(to_center, d);
  const Vectors off = to_center - d * middle;
  const Floats chord2 = half_chord2(light, dot(off, off));
  const Mask ahead = middle > 0;
  const Mask met = (ahead & (chord2 >= 0)) | !cone.outside;
  Appearance appearance =
      where(met, appearance_of(light, cone, middle, hn::Sqrt(hn::Max(chord2, zero))));
  appearance.emission.pdf = hn::IfThenElseZero(ahead, appearance.emission.pdf);
  return appearance;
}

HWY_INLINE Vectors redraw(const SphereLamp& light, Vectors from, Vectors d, Vectors other) {
  const Vectors center = set(static_cast<Vec3f>(light.center));
  const Cone here = cone_of(light, center - from);
  const Vectors local = world_to_frame(here.axis, d);
  const Floats one = set(1.0F);
  const Floats sine2 = hn::Min(mul_add(local.x, local.x, local.y * local.y), one);
  const Floats z = sine2 / (1 + hn::Sqrt(1 - sine2));
  const Floats to_unit = 1 / hn::Max(hn::Sqrt(sine2), set(1e-20F));
  return in_cone(cone_of(light, center - other), hn::Min(z / here.size, one), local.x * to_unit,
                 local.y * to_unit);
}

// The lamp grows where lines touch it as fast as it goes along its normal there.
HWY_INLINE Outline outline(const SphereLamp& light, Vectors from, Floats u, bool opposite) {
  const Vectors to_center = set(static_cast<Vec3f>(light.center)) - from;
  const Cone cone = cone_of(light, to_center);
  const Floats zero = hn::Zero(FloatTag());
  const Floats cosine = 1 - cone.size;
  const Floats sine = hn::Sqrt(cone.size * (1 + cosine));
  const Floats distance = hn::Sqrt(dot(to_center, to_center)) * cosine;
  const SinCos phi = sin_cos_2pi(u);
  const Floats side = set(opposite ? -1.0F : 1.0F);
  const Vectors outwards = frame_to_world(cone.axis, side * phi.cos, side * phi.sin, zero);
  const Floats by = std::numbers::pi_v<float> * sine / hn::Max(distance, set(1e-20F));
  return {renormalize(outwards * sine + cone.axis * cosine), distance,
          (outwards * cosine - cone.axis * sine) * hn::IfThenElseZero(cone.outside, by),
          set(static_cast<float>(light.radiance))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
