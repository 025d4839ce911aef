// A lamp that is a parallelogram and shines to one side, of the same radiance from everywhere
// there.
#ifndef ITN_TRACER_LIGHTS_PANEL_H_
#define ITN_TRACER_LIGHTS_PANEL_H_

#include <cmath>

#include "common/error.h"
#include "common/vec.h"
#include "server/tracer/lights/lamp.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

struct PanelLight {
  Vec3d center;          // outside of the medium
  Vec3d half_u, half_v;  // edges, halved
  double radiance = 1;   // W/(m^2 sr), to the side of cross(half_u, half_v)
  double distance2 = 1;  // once it is compiled: see LampPlace

  static constexpr const char* kName = "panel";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.position("center", self.center);
    to.position("half_u", self.half_u);
    to.position("half_v", self.half_v);
    to.number("radiance", self.radiance, 0, 1e9);
  }
  PanelLight compile(const LightFrame& frame) const {
    const LampPlace place = lamp_place(frame, "panel.center", center);
    const auto turned = frame.pose.rotation.inverse();
    const PanelLight compiled{place.position, turned(half_u), turned(half_v), radiance,
                              place.distance2};
    if (!(compiled.area() > 0)) {
      throw invalid_input("panel.half_u is parallel to half_v, or one of them is 0");
    }
    return compiled;
  }

  double area() const { return 4 * length(cross(half_u, half_v)); }
  static constexpr bool kDelta = true, kDistant = false;
  // As if it faced the object.
  double power() const { return radiance * area() / distance2; }
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

// All places of it alike.
HWY_INLINE Beam beam(const PanelLight& light, Vectors from, const LightUniforms& u) {
  const auto along = [](Floats v) { return hn::Sub(hn::Add(v, v), set(1.0F)); };
  const Vectors place = set(static_cast<Vec3f>(light.center)) +
                        set(static_cast<Vec3f>(light.half_u)) * along(u.u0) +
                        set(static_cast<Vec3f>(light.half_v)) * along(u.u1);
  const auto normal = static_cast<Vec3f>(itn::normalize(cross(light.half_u, light.half_v)));
  const Vectors to = place - from;
  const Floats d2 = hn::Max(dot(to, to), set(1e-20F)), distance = hn::Sqrt(d2);
  const Vectors direction = to * hn::Div(set(1.0F), distance);
  const Floats facing = hn::Max(hn::Neg(dot(direction, set(normal))), hn::Zero(FloatTag()));
  return {direction, distance,
          hn::Mul(facing, hn::Div(set(static_cast<float>(light.distance2)), d2))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
