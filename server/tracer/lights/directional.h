// Parallel light from one direction, which cannot be hit by chance.
#pragma once

#include "common/vec.h"

namespace itn::tracer {

struct DirectionalLight {
  Vec3d direction{0, 1, 0};  // towards the light; of unit length once it is compiled
  double irradiance = 1;     // on a surface that faces it

  static constexpr bool kDelta = true;
  double power() const { return irradiance; }
};

}  // namespace itn::tracer
