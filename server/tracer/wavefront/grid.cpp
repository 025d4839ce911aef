#include "server/tracer/wavefront/grid.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

namespace itn::tracer {
namespace {

// Cells of 1.6 times the edge of a square of two triangles' area hold about ten triangles where the
// surface passes: measured to be the fastest between more cells to visit and more triangles to
// test.
constexpr double kCellEdge = 1.6;
constexpr int64_t kMaxCells = int64_t{1} << 24;
constexpr uint32_t kMaxDistance = 255;

double area(const Mesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const auto corner = static_cast<Vec3d>(mesh.vertices[a]);
    sum += length(cross(static_cast<Vec3d>(mesh.vertices[b]) - corner,
                        static_cast<Vec3d>(mesh.vertices[c]) - corner)) /
           2;
  }
  return sum;
}

std::array<double, 3> components(Vec3f v) {
  return {v.x, v.y, v.z};
}

// A triangle as it is put into cells: a little enlarged, so that rounding never makes a line miss
// the cell in which it meets the triangle.
struct Placed {
  std::array<double, 3> low, high;  // bounding box
  Vec3d normal;
  double offset;  // normal . x = offset in its plane

  Placed(const Mesh& mesh, const std::array<uint32_t, 3>& triangle, double margin) {
    const auto a = components(mesh.vertices[triangle[0]]);
    const auto b = components(mesh.vertices[triangle[1]]);
    const auto c = components(mesh.vertices[triangle[2]]);
    for (size_t i = 0; i < 3; ++i) {
      low[i] = std::min({a[i], b[i], c[i]}) - margin;
      high[i] = std::max({a[i], b[i], c[i]}) + margin;
    }
    const auto corner = static_cast<Vec3d>(mesh.vertices[triangle[0]]);
    normal = cross(static_cast<Vec3d>(mesh.vertices[triangle[1]]) - corner,
                   static_cast<Vec3d>(mesh.vertices[triangle[2]]) - corner);
    offset = dot(normal, corner);
  }

  // Whether the plane passes through a cube given by its centre and half its edge.
  bool plane_meets(Vec3d centre, double half) const {
    const double reach = half * (std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z));
    return std::abs(dot(normal, centre) - offset) <= reach;
  }
};

}  // namespace

void BlockWriter::add(const Mesh& mesh, uint32_t triangle) {
  if (used_ == TriangleBlock::kSize) {
    blocks_.emplace_back();
    used_ = 0;
  }
  TriangleBlock& block = blocks_.back();
  const auto& [a, b, c] = mesh.triangles[triangle];
  const auto put = [&](TriangleBlock::Lane(&lanes)[3], Vec3f v) {
    lanes[0][used_] = v.x;
    lanes[1][used_] = v.y;
    lanes[2][used_] = v.z;
  };
  put(block.corners[0], mesh.vertices[a]);
  put(block.corners[1], mesh.vertices[b]);
  put(block.corners[2], mesh.vertices[c]);
  put(block.normal,
      cross(mesh.vertices[b] - mesh.vertices[a], mesh.vertices[c] - mesh.vertices[a]));
  ++used_;
}

Grid::Grid(const Mesh& mesh) {
  choose_cells(mesh);
  fill(mesh);
  measure_distances();
  mark_inside();
}

void Grid::choose_cells(const Mesh& mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d extent = static_cast<Vec3d>(box.max) - static_cast<Vec3d>(box.min);
  const double longest = std::max({extent.x, extent.y, extent.z});
  double cell = kCellEdge * std::sqrt(2 * area(mesh) / static_cast<double>(mesh.triangles.size()));
  cell = std::min(cell, longest);
  // A margin of a quarter cell all around, so that the outermost layer touches nothing by rounding.
  const auto cells_along = [&](double length) {
    return static_cast<int>(std::ceil(length / cell + 0.5));
  };
  const auto count = [&] {
    return int64_t{cells_along(extent.x)} * cells_along(extent.y) * cells_along(extent.z);
  };
  while (count() > kMaxCells) {
    cell *= 1.05;
  }
  edge = static_cast<float>(cell);
  inverse_edge = 1 / edge;
  low = box.min - Vec3f{edge, edge, edge} * 0.25F;
  size = {cells_along(extent.x), cells_along(extent.y), cells_along(extent.z)};
}

void Grid::fill(const Mesh& mesh) {
  const Bounds box = bounds(mesh);
  const double largest = std::max({std::abs(box.min.x), std::abs(box.min.y), std::abs(box.min.z),
                                   std::abs(box.max.x), std::abs(box.max.y), std::abs(box.max.z)});
  const double cell = edge, margin = 1e-3 * cell + 16 * FLT_EPSILON * largest;
  const auto origin = components(low);

  // Visits the cells that a triangle may touch.
  const auto for_cells = [&](uint32_t triangle, const auto& visit) {
    const Placed placed(mesh, mesh.triangles[triangle], margin);
    std::array<int, 3> first{}, last{};
    for (size_t i = 0; i < 3; ++i) {
      first[i] = std::clamp(static_cast<int>((placed.low[i] - origin[i]) / cell), 0, size[i] - 1);
      last[i] = std::clamp(static_cast<int>((placed.high[i] - origin[i]) / cell), 0, size[i] - 1);
    }
    for (int z = first[2]; z <= last[2]; ++z) {
      for (int y = first[1]; y <= last[1]; ++y) {
        for (int x = first[0]; x <= last[0]; ++x) {
          const Vec3d centre{origin[0] + (x + 0.5) * cell, origin[1] + (y + 0.5) * cell,
                             origin[2] + (z + 0.5) * cell};
          if (placed.plane_meets(centre, cell / 2 + margin)) {
            visit((static_cast<size_t>(z) * size[1] + y) * size[0] + x);
          }
        }
      }
    }
  };

  // Count, number the occupied cells, then list their triangles cell by cell.
  cells.assign(static_cast<size_t>(size[0]) * size[1] * size[2], 0);
  const auto triangles = static_cast<uint32_t>(mesh.triangles.size());
  for (uint32_t t = 0; t < triangles; ++t) {
    for_cells(t, [&](size_t cell_index) { ++cells[cell_index]; });
  }
  std::vector<uint32_t> begin{0};
  for (uint32_t& word : cells) {
    if (word > 0) {
      begin.push_back(begin.back() + word);
      word = kOccupied | static_cast<uint32_t>(begin.size() - 2);
    }
  }
  std::vector<uint32_t> next = begin, list(begin.back());
  for (uint32_t t = 0; t < triangles; ++t) {
    for_cells(t, [&](size_t cell_index) { list[next[cells[cell_index] & kPayload]++] = t; });
  }
  BlockWriter writer(blocks);
  for (size_t n = 0; n + 1 < begin.size(); ++n) {
    first_block.push_back(static_cast<uint32_t>(blocks.size()));
    writer.begin();
    for (uint32_t i = begin[n]; i < begin[n + 1]; ++i) {
      writer.add(mesh, list[i]);
    }
  }
  first_block.push_back(static_cast<uint32_t>(blocks.size()));
}

// Chebyshev distances, by one sweep forward and one backward over the neighbours that a sweep has
// already passed (exact for this metric: Rosenfeld, Pfaltz, "Distance functions on digital
// pictures", 1968).
void Grid::measure_distances() {
  const auto sweep = [&](int direction) {
    const auto count = static_cast<int64_t>(cells.size());
    for (int64_t i = 0; i < count; ++i) {
      const int64_t at = direction > 0 ? i : count - 1 - i;
      if (cells[at] & kOccupied) {
        continue;
      }
      const int x = static_cast<int>(at % size[0]);
      const int y = static_cast<int>(at / size[0] % size[1]);
      const int z = static_cast<int>(at / size[0] / size[1]);
      uint32_t nearest = direction > 0 ? kMaxDistance : cells[at];
      for (int n = 0; n < 13; ++n) {  // the 13 of 26 neighbours that come before, in this direction
        const int dx = n % 3 - 1, dy = n / 3 % 3 - 1, dz = n / 9 - 1;
        const int nx = x + direction * dx, ny = y + direction * dy, nz = z + direction * dz;
        if (nx < 0 || ny < 0 || nz < 0 || nx >= size[0] || ny >= size[1] || nz >= size[2]) {
          continue;
        }
        const uint32_t word = cells[(static_cast<size_t>(nz) * size[1] + ny) * size[0] + nx];
        nearest = std::min(nearest, word & kOccupied ? 1 : word + 1);
      }
      cells[at] = std::min(nearest, kMaxDistance);
    }
  };
  sweep(+1);
  sweep(-1);
}

// Whether the first crossing on a line from an empty cell along x leaves the medium. As the cell is
// empty, any point of it will do: one off the middle, which no edge of a mesh with round coordinates
// is likely to be seen through.
bool Grid::lies_inside(int x, int y, int z) const {
  const Vec3d from{low.x + (x + 0.5) * edge, low.y + (y + 0.6371) * edge,
                   low.z + (z + 0.2823) * edge};
  for (; x < size[0]; ++x) {
    const uint32_t word = cells[(static_cast<size_t>(z) * size[1] + y) * size[0] + x];
    if (!(word & kOccupied)) {
      continue;
    }
    const uint32_t n = word & kPayload;
    double nearest = low.x + (x + 1.0) * edge - from.x;  // crossings beyond belong to later cells
    bool found = false, leaves = false;
    for (uint32_t b = first_block[n]; b < first_block[n + 1]; ++b) {
      for (size_t i = 0; i < TriangleBlock::kSize; ++i) {
        const double slope = blocks[b].normal[0][i];
        const auto corner = [&](size_t k) {
          return Vec3d{blocks[b].corners[k][0][i], blocks[b].corners[k][1][i],
                       blocks[b].corners[k][2][i]} -
                 from;
        };
        const Vec3d a = corner(0), c = corner(1), e = corner(2);
        // As in nearest_in_block, for the direction (1, 0, 0).
        const auto passes = [&](Vec3d p, Vec3d q) { return (p.y * q.z - p.z * q.y) * slope >= 0; };
        if (slope == 0 || !passes(a, c) || !passes(c, e) || !passes(e, a)) {
          continue;
        }
        const double t = dot(cross(c - a, e - a), a) / cross(c - a, e - a).x;
        if (t >= 0 && t < nearest) {
          nearest = t;
          found = true;
          leaves = slope > 0;
        }
      }
    }
    if (found) {
      return leaves;
    }
  }
  return false;
}

// Empty cells that hang together lie on the same side of the boundary.
void Grid::mark_inside() {
  std::vector<bool> visited(cells.size());
  std::vector<size_t> pending, component;
  for (size_t seed = 0; seed < cells.size(); ++seed) {
    if (visited[seed] || (cells[seed] & kOccupied)) {
      continue;
    }
    component.clear();
    pending = {seed};
    visited[seed] = true;
    while (!pending.empty()) {
      const size_t at = pending.back();
      pending.pop_back();
      component.push_back(at);
      const size_t row = size[0], layer = row * size[1];
      const size_t x = at % row, y = at / row % size[1], z = at / layer;
      const auto visit = [&](bool exists, size_t neighbour) {
        if (exists && !visited[neighbour] && !(cells[neighbour] & kOccupied)) {
          visited[neighbour] = true;
          pending.push_back(neighbour);
        }
      };
      visit(x > 0, at - 1);
      visit(x + 1 < row, at + 1);
      visit(y > 0, at - row);
      visit(y + 1 < static_cast<size_t>(size[1]), at + row);
      visit(z > 0, at - layer);
      visit(z + 1 < static_cast<size_t>(size[2]), at + layer);
    }
    if (lies_inside(static_cast<int>(seed % size[0]), static_cast<int>(seed / size[0] % size[1]),
                    static_cast<int>(seed / size[0] / size[1]))) {
      for (const size_t at : component) {
        cells[at] |= kInside;
      }
    }
  }
}

size_t Grid::memory() const {
  return (cells.size() + first_block.size()) * sizeof(uint32_t) +
         blocks.size() * sizeof(TriangleBlock);
}

}  // namespace itn::tracer
