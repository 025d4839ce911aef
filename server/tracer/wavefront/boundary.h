// What straight lines meet: the boundary of the medium in a grid, and the surfaces.
#pragma once

#include <algorithm>
#include <cmath>

#include "server/tracer/wavefront/depths.h"
#include "server/tracer/wavefront/grid.h"
#include "server/tracer/wavefront/surfaces.h"

namespace itn::tracer {

struct Boundary {
  Boundary(const Mesh& object, const std::vector<DiffuseSurface>& diffuse)
      : grid(object), depths(object), surfaces(diffuse), bounds(itn::bounds(object)) {
    const auto reach = [](float a, float b) { return std::max(std::abs(a), std::abs(b)); };
    extent = std::max({reach(bounds.min.x, bounds.max.x), reach(bounds.min.y, bounds.max.y),
                       reach(bounds.min.z, bounds.max.z)});
  }
  size_t memory() const { return grid.memory() + depths.memory() + surfaces.memory(); }

  Grid grid;
  Depths depths;
  Surfaces surfaces;
  Bounds bounds;     // of the object
  float extent = 0;  // largest absolute coordinate of the object
};

}  // namespace itn::tracer
