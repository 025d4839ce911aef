// Opaque surfaces beside the object.
#pragma once

#include "common/geometry/mesh.h"

namespace itn::tracer {

// Reflects with radiance = reflectance * irradiance / pi on both sides.
struct DiffuseSurface {
  Mesh mesh;
  float reflectance = 0.5F;
};

}  // namespace itn::tracer
