// What straight lines meet: the boundary of the medium in a grid, and the surfaces.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "server/tracer/geometry/corner_normals.h"
#include "server/tracer/geometry/object.h"
#include "server/tracer/geometry/surface_triangles.h"

namespace itn::tracer {

struct Obstacles {
  // In the coordinates of the object's mesh.
  Obstacles(std::shared_ptr<const Object> object, const std::vector<DiffuseSurface>& diffuse,
            CornerNormals normals = {})
      : grid(object->grid),
        depth_grid(object->depth_grid),
        bounds(object->bounds),
        extent(object->extent),
        corner_normals(std::move(normals)),
        surfaces(diffuse),
        kept_(std::move(object)) {}

  const Grid& grid;
  const DepthGrid& depth_grid;
  const Bounds& bounds;                // of the object
  const float extent;                  // largest absolute coordinate of the object
  const CornerNormals corner_normals;  // of the boundary, where lines stop at it
  const Surfaces surfaces;

 private:
  std::shared_ptr<const Object> kept_;
};

}  // namespace itn::tracer
