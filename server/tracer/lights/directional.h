// Parallel light from one direction, which cannot be hit by chance.
#pragma once

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
    return {frame.to_scene.inverse()(itn::normalize(direction)), irradiance};
  }

  static constexpr bool kDelta = true;
  double power() const { return irradiance; }
};

}  // namespace itn::tracer
