// What straight lines meet: the boundary of the medium in a grid, and the surfaces.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "server/tracer/geometry/cell_normals.h"
#include "server/tracer/geometry/corner_normals.h"
#include "server/tracer/geometry/facets.h"
#include "server/tracer/geometry/object.h"
#include "server/tracer/geometry/surface_triangles.h"

namespace itn::tracer {

// What more is known of the boundary; what its kind has no use for is empty.
struct BoundaryDetails {
  std::shared_ptr<const CornerNormals> corners = std::make_shared<const CornerNormals>();
  std::shared_ptr<const CellNormals> cells = std::make_shared<const CellNormals>();
  std::shared_ptr<const Facets> facets = std::make_shared<const Facets>();
};

struct Obstacles {
  // In the coordinates of the object's mesh.
  Obstacles(std::shared_ptr<const Object> object, const std::vector<DiffuseSurface>& diffuse,
            BoundaryDetails details = {})
      : grid(object->grid),
        depth_grid(object->depth_grid),
        bounds(object->bounds),
        extent(object->extent),
        corner_normals(*details.corners),
        cell_normals(*details.cells),
        facets(*details.facets),
        surfaces(diffuse),
        kept_(std::move(object)),
        kept_details_(std::move(details)) {}

  const Grid& grid;
  const DepthGrid& depth_grid;
  const Bounds& bounds;  // of the object
  const float extent;    // largest absolute coordinate of the object
  const CornerNormals& corner_normals;
  const CellNormals& cell_normals;
  const Facets& facets;
  const Surfaces surfaces;

 private:
  std::shared_ptr<const Object> kept_;
  BoundaryDetails kept_details_;
};

}  // namespace itn::tracer
