#include "server/tracer/geometry/cell_normals.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace itn::tracer {
namespace {

// Packs the direction of a vector of any length but 0.
uint32_t pack(Vec3f n) {
  const float sum = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
  float u = n.x / sum, v = n.y / sum;
  if (n.z < 0) {
    const float folded = std::copysign(1 - std::abs(v), u);
    v = std::copysign(1 - std::abs(u), v);
    u = folded;
  }
  const auto bits = [](float x) {
    return static_cast<uint32_t>(std::lround((x + 1) * CellNormals::kPackedOne));
  };
  return bits(u) << 16 | bits(v);
}

// Outwards.
Vec3d twice_area(const Mesh& mesh, const std::array<uint32_t, 3>& triangle) {
  const auto corner = [&](size_t k) { return static_cast<Vec3d>(mesh.vertices[triangle[k]]); };
  return cross(corner(1) - corner(0), corner(2) - corner(0));
}

// Calls visit(cell, normal) for every cell that a triangle touches. The length of the normal is
// twice its area, or of a large one about what lies in the cell.
template <typename Visit>
void for_each_touch(const Mesh& mesh, const CubicCells& cells, Cancellation& cancellation,
                    const Visit& visit) {
  for (const auto& triangle : mesh.triangles) {
    cancellation.turn();
    const Vec3d area = twice_area(mesh, triangle);
    const double most = 2 * cells.edge * cells.edge;
    const auto normal = static_cast<Vec3f>(area * std::min(1 / most, 1 / length(area)));
    TriangleAmongCells(cells, mesh, triangle, 1e-3 * cells.edge).for_each([&](size_t cell) {
      visit(cell, normal);
    });
  }
}

std::vector<Vec3f> mean_normals(const Mesh& mesh, const CubicCells& cells,
                                Cancellation& cancellation) {
  std::vector<Vec3f> largest(cells.count()), sums(cells.count());
  for_each_touch(mesh, cells, cancellation, [&](size_t cell, Vec3f normal) {
    if (dot(normal, normal) > dot(largest[cell], largest[cell])) largest[cell] = normal;
  });
  for_each_touch(mesh, cells, cancellation, [&](size_t cell, Vec3f normal) {
    const float both = length(normal) * length(largest[cell]);
    if (dot(normal, largest[cell]) > CellNormals::kOneSurface * both) {
      sums[cell] = sums[cell] + normal;
    }
  });
  return sums;
}

}  // namespace

CellNormals::CellNormals(const Mesh& mesh, const DepthGrid& depth_grid,
                         const std::stop_token& stop) {
  Cancellation cancellation(stop);
  const CubicCells& cells = depth_grid.cells;
  const std::vector<uint8_t>& depths = depth_grid.quantized;
  const std::vector<Vec3f> means = mean_normals(mesh, cells, cancellation);
  packed.resize(cells.count());
  std::array<std::vector<uint32_t>, 256> by_depth;
  for (uint32_t cell = 0; cell < packed.size(); ++cell) {
    by_depth[depths[cell]].push_back(cell);
    if (dot(means[cell], means[cell]) > 0) packed[cell] = pack(means[cell]);
  }
  // Deeper cells take it from a neighbour that is nearer to the boundary by the step between them.
  const auto [nx, ny, nz] = cells.size;
  const auto nearer = [&, nx = nx, ny = ny, nz = nz](uint32_t cell) -> size_t {
    const auto number = static_cast<int>(cell);
    const int x = number % nx, y = number / nx % ny, z = number / nx / ny;
    for (int k = std::max(z - 1, 0); k <= std::min(z + 1, nz - 1); ++k) {
      for (int j = std::max(y - 1, 0); j <= std::min(y + 1, ny - 1); ++j) {
        for (int i = std::max(x - 1, 0); i <= std::min(x + 1, nx - 1); ++i) {
          const size_t other = cells.index(i, j, k);
          const int step = 2 + (i != x) + (j != y) + (k != z);
          if (depths[other] + step == depths[cell]) return other;
        }
      }
    }
    return cell;  // farther away than depths tell
  };
  for (size_t depth = 1; depth < by_depth.size(); ++depth) {
    for (const uint32_t cell : by_depth[depth]) {
      cancellation.turn();
      packed[cell] = packed[nearer(cell)];
    }
  }
}

}  // namespace itn::tracer
