// Space cut into equal cubes, and which of them a triangle touches. Internal to the tracer.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "common/geometry/mesh.h"

namespace itn::tracer {

struct CubicCells {
  Vec3d low;  // corner
  double edge = 1;
  std::array<int, 3> size{1, 1, 1};  // in cells

  size_t count() const { return static_cast<size_t>(size[0]) * size[1] * size[2]; }
  // x fastest.
  size_t index(int x, int y, int z) const {
    return (static_cast<size_t>(z) * size[1] + y) * size[0] + x;
  }
};

// Calls visit(index) for the cells whose cube, enlarged by the margin, meets both the bounding box
// and the plane of a triangle: all that it touches, and a few more at its corners.
template <typename Visit>
void for_touched_cells(const CubicCells& cells, const Mesh& mesh,
                       const std::array<uint32_t, 3>& triangle, double margin, const Visit& visit) {
  std::array<Vec3d, 3> corners;
  for (size_t k = 0; k < 3; ++k) {
    corners[k] = static_cast<Vec3d>(mesh.vertices[triangle[k]]) - cells.low;
  }
  const Vec3d normal = cross(corners[1] - corners[0], corners[2] - corners[0]);
  const double offset = dot(normal, corners[0]);
  const double reach =
      (cells.edge / 2 + margin) * (std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z));
  const auto range = [&](double a, double b, double c, int size) {
    const auto cell = [&](double x) {
      return std::clamp(static_cast<int>(x / cells.edge), 0, size - 1);
    };
    return std::array{cell(std::min({a, b, c}) - margin), cell(std::max({a, b, c}) + margin)};
  };
  const auto [a, b, c] = corners;
  const auto xs = range(a.x, b.x, c.x, cells.size[0]), ys = range(a.y, b.y, c.y, cells.size[1]),
             zs = range(a.z, b.z, c.z, cells.size[2]);
  for (int z = zs[0]; z <= zs[1]; ++z) {
    for (int y = ys[0]; y <= ys[1]; ++y) {
      for (int x = xs[0]; x <= xs[1]; ++x) {
        const Vec3d middle = Vec3d{x + 0.5, y + 0.5, z + 0.5} * cells.edge;
        if (std::abs(dot(normal, middle) - offset) <= reach) {
          visit(cells.index(x, y, z));
        }
      }
    }
  }
}

}  // namespace itn::tracer
