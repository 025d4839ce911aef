// Parallel light from one direction, which cannot be hit by chance.
#ifndef ITN_TRACER_LIGHTS_DIRECTIONAL_H_
#define ITN_TRACER_LIGHTS_DIRECTIONAL_H_

#include "common/vec.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

struct DirectionalLight {
  Vec3d direction{0, 1, 0};  // towards the light; of unit length once it is compiled
  double irradiance = 1;     // on a surface that faces it

  static constexpr const char* kName = "directional";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.direction("direction", self.direction);
    to.number("irradiance", self.irradiance, 0, 1e9);
  }
  DirectionalLight compile(const LightFrame& frame) const {
    return {frame.pose.rotation.inverse()(itn::normalize(direction)), irradiance};
  }

  static constexpr bool kDelta = true, kDistant = true;
  double power() const { return irradiance; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_LIGHTS_DIRECTIONAL_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_DIRECTIONAL_MATHS_
#undef ITN_TRACER_LIGHTS_DIRECTIONAL_MATHS_
#else
#define ITN_TRACER_LIGHTS_DIRECTIONAL_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Beam beam(const DirectionalLight& light, Vectors /*from*/) {
  return {set(static_cast<Vec3f>(light.direction)), set(kInfinity), set(1.0F)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
