// A lamp so small that it is a point, which shines alike in all directions.
#ifndef ITN_TRACER_LIGHTS_POINT_H_
#define ITN_TRACER_LIGHTS_POINT_H_

#include "common/vec.h"
#include "server/tracer/lights/lamp.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

// What is rendered, in the coordinates of the object.
struct PointLamp {
  Vec3d position;
  double intensity;
  double distance2;  // see LampPlace

  static constexpr bool kDelta = true, kDistant = false;
  double power() const { return intensity * kSquareMmPerSquareM / distance2; }
};

struct PointLight {
  Vec3d position;        // outside of the medium
  double intensity = 1;  // W/sr

  static constexpr const char* kName = "point";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.position("position", self.position);
    to.number("intensity", self.intensity, 0, 1e9);
  }
  bool has_size() const { return false; }
  PointLamp compile(const LightFrame& frame) const {
    const LampPlace place = lamp_place(frame, "point.position", position);
    return {place.position, intensity, place.distance2};
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_POINT_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_POINT_MATHS_
#undef ITN_TRACER_LIGHTS_POINT_MATHS_
#else
#define ITN_TRACER_LIGHTS_POINT_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Beam beam(const PointLamp& light, Vectors from) {
  return beam_from(set(static_cast<Vec3f>(light.position)), light.distance2, from);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
