// A lamp that is a parallelogram and shines to one side, of the same radiance from everywhere
// there. Its other side is black.
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
  // Once it is compiled: see LampPlace; the normal of the side that shines; and what places of it
  // times `across_u` are in [-1, 1] by, along half_u, and likewise.
  double distance2 = 1;
  Vec3d normal = {}, across_u = {}, across_v = {};

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
            cross(n, u) * (1 / dot(n, n))};
  }

  static constexpr bool kDelta = false, kDistant = false;
  double area() const { return 4 * length(cross(half_u, half_v)); }
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

// Along a unit direction, at a distance from its front or back.
HWY_INLINE Appearance appearance_of(const PanelLight& light, Floats facing, Floats distance) {
  const Floats by_area = hn::Mul(hn::Abs(facing), set(static_cast<float>(light.area())));
  return {distance,
          {hn::IfThenElseZero(hn::Lt(facing, hn::Zero(FloatTag())),
                              set(static_cast<float>(light.radiance))),
           hn::Div(hn::Mul(distance, distance), hn::Max(by_area, set(1e-30F)))}};
}

// All places of it alike.
HWY_INLINE LampDraw draw(const PanelLight& light, Vectors from, const LightUniforms& u) {
  const auto along = [](Floats v) { return hn::Sub(hn::Add(v, v), set(1.0F)); };
  const Vectors place = set(static_cast<Vec3f>(light.center)) +
                        set(static_cast<Vec3f>(light.half_u)) * along(u.u0) +
                        set(static_cast<Vec3f>(light.half_v)) * along(u.u1);
  const Vectors to = place - from;
  const Floats distance = hn::Sqrt(hn::Max(dot(to, to), set(1e-20F)));
  const Vectors direction = to * hn::Div(set(1.0F), distance);
  const Floats facing = dot(direction, set(static_cast<Vec3f>(light.normal)));
  return {direction, appearance_of(light, facing, distance)};
}

HWY_INLINE Appearance look(const PanelLight& light, Vectors from, Vectors d) {
  const Vectors normal = set(static_cast<Vec3f>(light.normal));
  const Vectors to_center = set(static_cast<Vec3f>(light.center)) - from;
  const Floats facing = dot(normal, d), t = hn::Div(dot(normal, to_center), facing);
  const Vectors place = d * t - to_center;
  const auto within = [&](Vec3d across) {
    return hn::Le(hn::Abs(dot(place, set(static_cast<Vec3f>(across)))), set(1.0F));
  };
  const Mask met = hn::And(hn::Gt(t, hn::Zero(FloatTag())),
                           hn::And(within(light.across_u), within(light.across_v)));
  return where(met, appearance_of(light, facing, t));
}

HWY_INLINE Vectors redraw(const PanelLight& light, Vectors from, Vectors d, Vectors other) {
  return normalize(from + d * look(light, from, d).distance - other);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
