// Opaque surfaces beside the object.
#pragma once

#include <utility>

#include "common/geometry/mesh.h"
#include "server/tracer/surfaces/reflectance.h"

namespace itn::tracer {

// Reflects with radiance = reflectance * irradiance / pi on both sides.
struct DiffuseSurface {
  DiffuseSurface() = default;
  DiffuseSurface(Mesh of, Reflectance by) : mesh(std::move(of)), reflectance(std::move(by)) {}
  DiffuseSurface(Mesh of, float by) : mesh(std::move(of)), reflectance(UniformReflectance{by}) {}

  Mesh mesh;
  Reflectance reflectance;
  // In radians: triangles that meet under less bound one smooth surface (CornerNormals). 0: flat.
  double smooth_angle = 0;
};

}  // namespace itn::tracer
