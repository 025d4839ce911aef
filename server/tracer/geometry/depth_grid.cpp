#include "server/tracer/geometry/depth_grid.h"

namespace itn::tracer {
namespace {

constexpr uint8_t kFarthest = 255;

// Coarser where large triangles are so many that finding the cells of each would take long.
double most_touches(size_t triangles) {
  return 16 * static_cast<double>(triangles) + (1 << 20);
}

CubicCells cells_around(const Mesh& mesh, Cancellation& cancellation) {
  const Bounds box = bounds(mesh);
  const auto low = static_cast<Vec3d>(box.min);
  const Vec3d extent = static_cast<Vec3d>(box.max) - low;
  const double edge =
      std::max(std::max({extent.x, extent.y, extent.z}) / DepthGrid::kCells,
               ExpectedTouches(mesh, cancellation).edge_for(most_touches(mesh.triangles.size())));
  const auto count = [&](double length) {
    return std::clamp(static_cast<int>(std::ceil(length / edge)), 1, DepthGrid::kCells);
  };
  return {low, edge, {count(extent.x), count(extent.y), count(extent.z)}};
}

}  // namespace

// The chamfer distance of Borgefors ("Distance transformations in arbitrary dimensions", 1984): a
// step to a neighbour costs 3, 4 or 5, by whether they share a face, an edge or a corner. One pass
// forth, looking at the neighbours behind, and one back. A row looks at its neighbouring rows, all
// of its cells at once, then along itself.
DepthGrid::DepthGrid(const Mesh& mesh, const std::stop_token& stop) {
  Cancellation cancellation(stop);
  cells = cells_around(mesh, cancellation);
  quantized.assign(cells.count() + 3, kFarthest);
  for (const auto& triangle : mesh.triangles) {
    cancellation.turn();
    TriangleAmongCells(cells, mesh, triangle, 1e-3 * cells.edge).for_each([&](size_t cell) {
      quantized[cell] = 0;
    });
  }
  const int nx = cells.size[0], ny = cells.size[1], nz = cells.size[2];
  // With a cell more at either end, that each has neighbours.
  using Row = std::vector<uint8_t>;
  const Row outside(nx + 2, kFarthest);
  Row here = outside, near = outside;
  const auto look_at = [&](int y, int z, int cost) {
    if (y < 0 || y >= ny || z < 0 || z >= nz) return;
    std::copy_n(&quantized[cells.index(0, y, z)], nx, near.begin() + 1);
    for (int i = 1; i <= nx; ++i) {
      const int across = std::min(near[i - 1], near[i + 1]);
      const int least = std::min(near[i] + cost, across + cost + 1);
      here[i] = static_cast<uint8_t>(std::min<int>(here[i], least));
    }
  };
  const auto pass = [&](int forth) {
    const auto place = [&](int i, int n) { return forth > 0 ? i : n - 1 - i; };
    for (int k = 0; k < nz; ++k) {
      check_cancelled(stop);
      for (int j = 0; j < ny; ++j) {
        const int y = place(j, ny), z = place(k, nz);
        uint8_t* const row = &quantized[cells.index(0, y, z)];
        std::copy_n(row, nx, here.begin() + 1);
        look_at(y - 1, z - forth, 4);
        look_at(y, z - forth, 3);
        look_at(y + 1, z - forth, 4);
        look_at(y - forth, z, 3);
        for (int i = 0; i < nx; ++i) {
          const int x = place(i, nx) + 1;
          here[x] = static_cast<uint8_t>(std::min<int>(here[x], here[x - forth] + 3));
        }
        std::copy_n(here.begin() + 1, nx, row);
      }
    }
  };
  pass(1);
  pass(-1);
}

}  // namespace itn::tracer
