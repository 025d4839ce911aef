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

struct SphereLight {
  Vec3d center;          // outside of the medium
  double radius = 1;     // mm
  double radiance = 1;   // W/(m^2 sr)
  double distance2 = 1;  // once it is compiled: see LampPlace

  static constexpr const char* kName = "sphere";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.position("center", self.center);
    to.number("radius", self.radius, 1e-6, 1e6);
    to.number("radiance", self.radiance, 0, 1e9);
  }
  SphereLight compile(const LightFrame& frame) const {
    const LampPlace place = lamp_place(frame, "sphere.center", center);
    if (!(radius * radius < place.distance2)) {
      throw invalid_input("sphere.radius: the object is in the lamp; it must stand outside of it");
    }
    return {place.position, radius, radiance, place.distance2};
  }

  static constexpr bool kDelta = true, kDistant = false;
  double power() const { return std::numbers::pi * radiance * radius * radius / distance2; }
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

// In the cone that it is seen in, all directions alike; nothing from inside of it. With
// z = 1 - cos_theta, as those of a sun (sun_disc.h).
HWY_INLINE Beam beam(const SphereLight& light, Vectors from, const LightUniforms& u) {
  const Floats one = set(1.0F), zero = hn::Zero(FloatTag());
  const auto radius2 = static_cast<float>(light.radius * light.radius);
  const Vectors to = set(static_cast<Vec3f>(light.center)) - from;
  const Floats d2 = dot(to, to);
  const Mask outside = hn::Gt(d2, set(radius2));
  const Floats distance = hn::Sqrt(hn::Max(d2, set(radius2)));
  const Floats sine2 = hn::IfThenElse(outside, hn::Div(set(radius2), d2), one);
  const Floats cap = hn::Div(sine2, hn::Add(one, hn::Sqrt(hn::Sub(one, sine2))));  // largest z
  const Floats z = hn::Mul(u.u0, cap), cosine = hn::Sub(one, z);
  const Floats sine = hn::Sqrt(hn::Mul(z, hn::Sub(set(2.0F), z)));
  const SinCos phi = sin_cos_2pi(u.u1);
  const Vectors axis = to * hn::Div(one, hn::Max(hn::Sqrt(d2), set(1e-20F)));
  const Vectors direction =
      renormalize(frame_to_world(axis, hn::Mul(sine, phi.cos), hn::Mul(sine, phi.sin), cosine));
  const Floats half_chord2 = hn::Sub(set(radius2), hn::Mul(hn::Mul(sine, sine), d2));
  const Floats to_surface =
      hn::Sub(hn::Mul(distance, cosine), hn::Sqrt(hn::Max(half_chord2, zero)));
  // 2 pi cap radiance, over power().
  const auto by_cap = static_cast<float>(2 * light.distance2 / (light.radius * light.radius));
  return {direction, hn::Max(to_surface, zero),
          hn::IfThenElseZero(outside, hn::Mul(cap, set(by_cap)))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
