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
  Vec3d normal = {};     // likewise, of the side that shines

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
    const Vec3d u = turned(half_u), v = turned(half_v);
    if (!(length(cross(u, v)) > 0)) {
      throw invalid_input("panel.half_u is parallel to half_v, or one of them is 0");
    }
    return {place.position, u, v, radiance, place.distance2, itn::normalize(cross(u, v))};
  }

  static constexpr bool kDelta = true, kDistant = false;
  // As if it faced the object.
  double power() const { return radiance * 4 * length(cross(half_u, half_v)) / distance2; }
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
  Beam arriving = beam_from(place, light.distance2, from);
  const Floats facing = hn::Neg(dot(arriving.direction, set(static_cast<Vec3f>(light.normal))));
  arriving.irradiance = hn::Mul(hn::Max(facing, hn::Zero(FloatTag())), arriving.irradiance);
  return arriving;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
