// Parallel light from one direction, which cannot be hit by chance.
#pragma once

#include "common/vec.h"

namespace itn::tracer {

struct DistantSource {
  Vec3f direction;        // towards the light, a unit vector
  double irradiance = 0;  // on a surface that faces it

  double power() const { return irradiance; }
};

}  // namespace itn::tracer
