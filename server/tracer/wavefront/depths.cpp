#include "server/tracer/wavefront/depths.h"

namespace itn::tracer {
namespace {

// Along the longest side of the mesh: about as fine as light falls off in the paper's materials,
// yet all of them fit into a processor's second cache.
constexpr int kCells = 64;

CubicCells cells_around(const Mesh& mesh) {
  const Bounds box = bounds(mesh);
  const auto low = static_cast<Vec3d>(box.min);
  const Vec3d extent = static_cast<Vec3d>(box.max) - low;
  const double edge = std::max({extent.x, extent.y, extent.z}) / kCells;
  const auto count = [&](double length) {
    return std::clamp(static_cast<int>(std::ceil(length / edge)), 1, kCells);
  };
  return {low, edge, {count(extent.x), count(extent.y), count(extent.z)}};
}

}  // namespace

// The chamfer distance of Borgefors ("Distance transformations in arbitrary dimensions", 1984): a
// step to a neighbour costs 3, 4 or 5, by whether they share a face, an edge or a corner. One pass
// forth, looking at the neighbours behind, and one back.
Depths::Depths(const Mesh& mesh) : cells(cells_around(mesh)) {
  thirds.assign(cells.count() + 3, 255);
  for (const auto& triangle : mesh.triangles) {
    for_touched_cells(cells, mesh, triangle, 1e-3 * cells.edge,
                      [&](size_t cell) { thirds[cell] = 0; });
  }
  const auto [nx, ny, nz] = cells.size;
  const auto pass = [&](int direction) {
    const auto place = [&](int i, int n) { return direction > 0 ? i : n - 1 - i; };
    for (int k = 0; k < nz; ++k) {
      for (int j = 0; j < ny; ++j) {
        for (int i = 0; i < nx; ++i) {
          const int x = place(i, nx), y = place(j, ny), z = place(k, nz);
          int least = thirds[cells.index(x, y, z)];
          const auto look = [&](int dx, int dy, int dz) {
            const int u = x - dx * direction, v = y - dy * direction, w = z - dz * direction;
            if (u >= 0 && u < nx && v >= 0 && v < ny && w >= 0 && w < nz) {
              const int cost = 2 + std::abs(dx) + std::abs(dy) + std::abs(dz);
              least = std::min(least, thirds[cells.index(u, v, w)] + cost);
            }
          };
          for (int dy = -1; dy <= 1; ++dy) {
            for (int dx = -1; dx <= 1; ++dx) {
              look(dx, dy, 1);
            }
          }
          for (int dx = -1; dx <= 1; ++dx) {
            look(dx, 1, 0);
          }
          look(1, 0, 0);
          thirds[cells.index(x, y, z)] = static_cast<uint8_t>(least);
        }
      }
    }
  };
  pass(1);
  pass(-1);
}

}  // namespace itn::tracer
