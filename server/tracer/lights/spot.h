// A lamp that is a point and shines in a cone.
#ifndef ITN_TRACER_LIGHTS_SPOT_H_
#define ITN_TRACER_LIGHTS_SPOT_H_

#include <algorithm>
#include <cmath>

#include "common/angle.h"
#include "common/error.h"
#include "common/vec.h"
#include "server/tracer/lights/lamp.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

// What is rendered, in the coordinates of the object.
struct SpotLamp {
  Vec3d position, direction;  // the direction that it shines in is of unit length
  double intensity;
  double distance2;  // see LampPlace
  // The cosine of the outer angle, and 1 over how much that of the inner one is above it.
  float outer_cosine, per_cosine;

  static constexpr bool kDelta = true, kDistant = false;
  // The power as if it were turned to the object.
  double power() const { return intensity * kSquareMmPerSquareM / distance2; }
};

struct SpotLight {
  Vec3d position;        // outside of the medium
  Vec3d target;          // the place that it is turned to
  double intensity = 1;  // W/sr, up to the inner angle; from there to the outer one it fades
  double inner_angle = 20 * kRadiansPerDegree, outer_angle = 25 * kRadiansPerDegree;

  static constexpr const char* kName = "spot";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.position("position", self.position);
    to.position("target", self.target);
    to.number("intensity", self.intensity, 0, 1e9);
    to.angle("inner_angle_degrees", self.inner_angle, 0, 90);
    to.angle("outer_angle_degrees", self.outer_angle, 0.1, 90);
  }
  bool has_size() const { return false; }
  SpotLamp compile(const LightFrame& frame) const {
    const LampPlace place = lamp_place(frame, "spot.position", position);
    const Vec3d direction = frame.pose.to_object(target) - place.position;
    if (!(dot(direction, direction) > 0)) {
      throw invalid_input("spot.target is its position; it must be another place");
    }
    if (!(inner_angle <= outer_angle)) {
      throw invalid_input("spot.inner_angle_degrees is above outer_angle_degrees");
    }
    const double outer = std::cos(outer_angle);
    return {place.position,
            itn::normalize(direction),
            intensity,
            place.distance2,
            static_cast<float>(outer),
            static_cast<float>(1 / std::max(std::cos(inner_angle) - outer, 1e-6))};
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_SPOT_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_SPOT_MATHS_
#undef ITN_TRACER_LIGHTS_SPOT_MATHS_
#else
#define ITN_TRACER_LIGHTS_SPOT_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Beam beam(const SpotLamp& light, Vectors from) {
  Beam arriving = beam_from(set(static_cast<Vec3f>(light.position)), light.distance2, from);
  const Floats cosine = -dot(arriving.direction, set(static_cast<Vec3f>(light.direction)));
  // 0 at the outer angle, 1 at the inner one, level at both.
  const Floats t =
      hn::Clamp((cosine - light.outer_cosine) * light.per_cosine, hn::Zero(FloatTag()), set(1.0F));
  const Floats fade = t * t * (3 - (t + t));
  arriving.irradiance *= fade;
  return arriving;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
