// Light from one direction, which cannot be hit by chance, or from a disc around it.
#ifndef ITN_TRACER_LIGHTS_DIRECTIONAL_H_
#define ITN_TRACER_LIGHTS_DIRECTIONAL_H_

#include <numbers>
#include <tuple>

#include "common/error.h"
#include "common/vec.h"
#include "server/tracer/lights/light_frame.h"
#include "server/tracer/lights/sun_disc.h"

namespace itn::tracer {

// What is rendered, in the coordinates of the object, where it is no disc.
struct ParallelLight {
  Vec3d direction;  // towards the light, of unit length
  double irradiance;

  static constexpr bool kDelta = true, kDistant = true;
  double power() const { return irradiance; }
};

struct DirectionalLight {
  Vec3d direction{0, 1, 0};  // towards the light
  double irradiance = 1;     // on a surface that faces it
  double angular_radius = 0;

  static constexpr const char* kName = "directional";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.moving_direction("direction", self.direction);
    to.number("irradiance", self.irradiance, 0, 1e9);
    to.angle("angular_radius_degrees", self.angular_radius, 0, 45);
  }
  bool has_size() const { return angular_radius > 0; }
  // One of them, the other of no power.
  std::tuple<ParallelLight, SunDisc> compile(const LightFrame& frame) const {
    constexpr double kSmallest = 0.1 * std::numbers::pi / 180;  // that floats resolve
    if (angular_radius > 0 && angular_radius < kSmallest) {
      throw invalid_input("directional.angular_radius_degrees must be 0, or in [0.1, 45]");
    }
    const Vec3d axis = frame.pose.rotation.inverse()(itn::normalize(direction));
    if (angular_radius > 0) return {{axis, 0}, SunDisc(axis, angular_radius, irradiance)};
    return {{axis, irradiance}, SunDisc(axis, kSmallest, 0)};
  }
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

HWY_INLINE Beam beam(const ParallelLight& light, Vectors /*from*/) {
  return {set(static_cast<Vec3f>(light.direction)), set(kInfinity), set(1.0F)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
