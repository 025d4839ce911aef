#include "server/tracer/geometry/grid.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "common/error.h"
#include "common/threads.h"
#include "server/tracer/geometry/cubic_cells.h"

namespace itn::tracer {
namespace {

// Cells of 1.6 times the edge of a square of two triangles' area hold about ten triangles where the
// surface passes: measured to be the fastest between more cells to visit and more triangles to
// test.
constexpr double kCellEdge = 1.6;
// Cells along the longest side, at least: in a mesh of few large triangles most flights then stay
// among empty cells.
constexpr double kMinCells = 24;
// Objects whose longest side is more than so many times their thickness are thin.
constexpr double kThin = 100;

// What a grid may cost: the same of every mesh by the number of its triangles, however thin, large
// or often repeated they are. Scans take a fifth to a half of it; where a mesh would take more, its
// cells are made larger. The constants are for small meshes.
constexpr size_t most_cells(size_t triangles) {
  return std::min(16 * triangles + (size_t{1} << 20), size_t{1} << 24);
}
constexpr size_t most_blocks(size_t triangles) {
  return triangles + (size_t{1} << 14);
}
// The most references to triangles in cells.
constexpr size_t most_references(size_t triangles) {
  return 8 * triangles + (size_t{1} << 16);
}
static_assert(most_references(Grid::kMaxTriangles) < uint64_t{1} << 32,
              "they are counted in 32 bits");

// The length of the axes of cells, before they are rounded to integers.
constexpr double kAxisLength = 127;

Vec3d axis_of(const std::vector<Vec3d>& normals) {
  Vec3d sum{};
  for (const Vec3d& n : normals) sum = sum + n;
  // The two sides of a thin sheet cancel: either will do.
  const Vec3d direction = length(sum) > 0.1 ? itn::normalize(sum)
                          : normals.empty() ? Vec3d{0, 1, 0}
                                            : normals.front();
  return {std::round(direction.x * kAxisLength), std::round(direction.y * kAxisLength),
          std::round(direction.z * kAxisLength)};
}

// See OccupiedCell::normals: n . d > 0 for all d within 90 degrees less the half angle of the cone
// around the axis that holds all n, that is, where d . axis > |axis| sin(half angle).
uint32_t cone_of(const std::vector<Vec3d>& normals, Vec3d axis) {
  constexpr double kNone = 255;
  double least = 1;
  for (const Vec3d& n : normals) least = std::min(least, dot(n, axis) / length(axis));
  constexpr double kMargin = 1.5;  // against rounding, of a direction and of slivers' normals
  const double threshold =
      least > 0 ? std::ceil(length(axis) * std::sqrt(std::max(0.0, 1 - least * least)) + kMargin)
                : kNone;
  const auto byte = [](double v) { return static_cast<uint32_t>(static_cast<int>(v)) & 255U; };
  return byte(axis.x) | byte(axis.y) << 8 | byte(axis.z) << 16 |
         static_cast<uint32_t>(std::min(threshold, kNone)) << 24;
}

// See OccupiedCell::slab; `low` and `high` as fractions of its scale, with a margin.
uint32_t slab_of(double low, double high) {
  const auto number = [](double v, auto round) {
    return static_cast<uint32_t>(std::clamp(round((v + 1) / 2 * 65535), 0.0, 65535.0));
  };
  constexpr double kMargin = 2e-3;
  return number(low - kMargin, [](double v) { return std::floor(v); }) |
         number(high + kMargin, [](double v) { return std::ceil(v); }) << 16;
}

// The sum over the first group of crossings before `end`, neighbours less than `apart` from each
// other, whose sum is not 0; 0 if there is none.
int first_side(const std::map<uint32_t, std::pair<double, int>>& crossings, double end,
               double apart) {
  std::vector<std::pair<double, int>> sorted;
  sorted.reserve(crossings.size());
  for (const auto& [triangle, crossing] : crossings) sorted.push_back(crossing);
  std::ranges::sort(sorted);
  int sum = 0;
  for (size_t i = 0; i < sorted.size() && sorted[i].first < end; ++i) {
    sum += sorted[i].second;
    const bool last = i + 1 == sorted.size() || sorted[i + 1].first - sorted[i].first >= apart;
    if (last && sum != 0) return sum;
  }
  return 0;
}

}  // namespace

Grid::Grid(const Mesh& mesh, const std::stop_token& stop) {
  if (mesh.triangles.size() > kMaxTriangles) {
    throw Error(ErrorKind::kLimit,
                fmt::format("the object has {} triangles; at most {} are possible",
                            mesh.triangles.size(), kMaxTriangles));
  }
  Cancellation cancellation(stop);
  choose_cells(mesh, cancellation);
  fill(mesh, cancellation);
  measure_skips(stop);
  mark_inside(cancellation);
}

size_t Grid::most_memory(size_t triangles) {
  const size_t cells = most_cells(triangles), blocks = most_blocks(triangles);
  const size_t kept =
      cells * (sizeof(uint32_t) + 8) +
      blocks * (sizeof(TriangleBlock) + sizeof(numbers.front()) + sizeof(OccupiedCell));
  const size_t listing = (most_references(triangles) * 2 + blocks + triangles) * sizeof(uint32_t);
  const size_t marking = cells * 2 * sizeof(uint32_t) + cells / 8;
  return kept + std::max(listing, marking);
}

void Grid::choose_cells(const Mesh& mesh, Cancellation& cancellation) {
  const size_t triangles = mesh.triangles.size();
  const Bounds box = bounds(mesh);
  const Vec3d extent = static_cast<Vec3d>(box.max) - static_cast<Vec3d>(box.min);
  const double longest = std::max({extent.x, extent.y, extent.z});
  is_thin = longest > kThin * thickness(mesh);
  double cell = kCellEdge * std::sqrt(2 * area(mesh) / static_cast<double>(triangles));
  cell = std::min(cell, longest / kMinCells);
  const ExpectedTouches expected(mesh, cancellation);
  cell = std::max(cell, expected.edge_for(static_cast<double>(most_references(triangles))));
  // A margin of a quarter cell all around, so that the outermost layer touches nothing by rounding.
  const auto cells_along = [&](double length) { return std::ceil(length / cell + 0.5); };
  const auto too_many = [&] {
    return cells_along(extent.x) * cells_along(extent.y) * cells_along(extent.z) >
           static_cast<double>(most_cells(triangles));
  };
  while (too_many()) cell *= 1.05;
  place_cells(box, cell);
}

void Grid::place_cells(const Bounds& box, double cell) {
  const auto cells_along = [&](float from, float to) {
    return static_cast<int>(std::ceil((double{to} - double{from}) / cell + 0.5));
  };
  edge = static_cast<float>(cell);
  inverse_edge = 1 / edge;
  slab_scale = static_cast<float>(1.01 * (kAxisLength + 1) * std::sqrt(3.0) / 2 * cell);
  low = box.min - Vec3f{edge, edge, edge} * 0.25F;
  size = {cells_along(box.min.x, box.max.x), cells_along(box.min.y, box.max.y),
          cells_along(box.min.z, box.max.z)};
}

// The cells that triangles touch, triangle by triangle, and how many blocks they need there.
struct Grid::Touched {
  std::vector<uint32_t> cells, count_of_triangle;
  size_t blocks = 0;
};

// Leaves the number of its triangles in every cell. Nothing if the grid would cost more than it
// may.
std::optional<Grid::Touched> Grid::touched_cells(const Mesh& mesh, Cancellation& cancellation) {
  const Bounds box = bounds(mesh);
  const double largest = std::max({std::abs(box.min.x), std::abs(box.min.y), std::abs(box.min.z),
                                   std::abs(box.max.x), std::abs(box.max.y), std::abs(box.max.z)});
  const CubicCells placed{static_cast<Vec3d>(low), edge, size};
  const double margin = 1e-3 * double{edge} + 16 * FLT_EPSILON * largest;
  const size_t triangles = mesh.triangles.size();
  Touched touched;
  touched.cells.reserve(most_references(triangles));
  touched.count_of_triangle.reserve(triangles);
  cells.assign(placed.count(), 0);
  for (const auto& triangle : mesh.triangles) {
    cancellation.turn();
    const size_t before = touched.cells.size();
    TriangleAmongCells(placed, mesh, triangle, margin).for_each([&](size_t cell_index) {
      touched.blocks += cells[cell_index]++ % TriangleBlock::kSize == 0 ? 1 : 0;
      touched.cells.push_back(static_cast<uint32_t>(cell_index));
    });
    touched.count_of_triangle.push_back(static_cast<uint32_t>(touched.cells.size() - before));
    if (touched.cells.size() > most_references(triangles) ||
        touched.blocks > most_blocks(triangles)) {
      return {};
    }
  }
  return touched;
}

void Grid::fill(const Mesh& mesh, Cancellation& cancellation) {
  // What was expected is exceeded where triangles lie on faces of cells more often than by chance,
  // or many cells hold one each. A cell that holds the whole mesh is never too much.
  std::optional<Touched> touched = touched_cells(mesh, cancellation);
  while (!touched) {
    place_cells(bounds(mesh), 1.25 * double{edge});
    touched = touched_cells(mesh, cancellation);
  }
  // Number the occupied cells, then list their triangles cell by cell.
  std::vector<uint32_t> next{0};
  for (uint32_t& word : cells) {
    if (word > 0) {
      next.push_back(next.back() + word);
      word = kOccupied | static_cast<uint32_t>(next.size() - 2);
    }
  }
  std::vector<uint32_t> list(touched->cells.size());
  const uint32_t* cell_index = touched->cells.data();
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    cancellation.turn();
    for (uint32_t i = 0; i < touched->count_of_triangle[t]; ++i) {
      list[next[cells[*cell_index++] & kPayload]++] = t;
    }
  }
  blocks.reserve(touched->blocks);
  numbers.reserve(touched->blocks);
  occupied.reserve(next.size() - 1);
  touched.reset();
  size_t begin = 0;
  for (size_t i = 0; i < cells.size(); ++i) {
    if (cells[i] & kOccupied) {
      const size_t end = next[cells[i] & kPayload];  // where the next list begins, by now
      add_cell(mesh, i, {list.data() + begin, end - begin}, cancellation);
      begin = end;
    }
  }
}

// The occupied cells come in the order of their numbers.
void Grid::add_cell(const Mesh& mesh, size_t cell_index, std::span<const uint32_t> triangles,
                    Cancellation& cancellation) {
  const auto middle_of = [&](float from, size_t cell) {
    return from + (static_cast<float>(cell) + 0.5F) * edge;
  };
  const size_t row = size[0], layer = row * size[1];
  const Vec3f middle{middle_of(low.x, cell_index % row),
                     middle_of(low.y, cell_index / row % size[1]),
                     middle_of(low.z, cell_index / layer)};
  const auto first = static_cast<uint32_t>(blocks.size());
  std::vector<Vec3d> normals;
  for (size_t i = 0; i < triangles.size(); ++i) {
    cancellation.turn();
    const size_t place = i % TriangleBlock::kSize;
    if (place == 0) {
      blocks.emplace_back();
      numbers.emplace_back();
    }
    numbers.back()[place] = triangles[i];
    const auto& triangle = mesh.triangles[triangles[i]];
    for (size_t k = 0; k < 3; ++k) {
      const Vec3f corner = mesh.vertices[triangle[k]] - middle;
      blocks.back().corners[k][0][place] = corner.x;
      blocks.back().corners[k][1][place] = corner.y;
      blocks.back().corners[k][2][place] = corner.z;
    }
    const auto exact = [&](size_t k) { return static_cast<Vec3d>(mesh.vertices[triangle[k]]); };
    const Vec3d normal = cross(exact(1) - exact(0), exact(2) - exact(0));
    if (length(normal) > 0) normals.push_back(itn::normalize(normal));
  }
  const Vec3d axis = axis_of(normals);
  double lowest = 1, highest = -1;
  for (const uint32_t t : triangles) {
    cancellation.turn();
    for (const uint32_t vertex : mesh.triangles[t]) {
      const Vec3d x = static_cast<Vec3d>(mesh.vertices[vertex]) - static_cast<Vec3d>(middle);
      const double along = dot(axis, x) / double{slab_scale};
      lowest = std::min(lowest, along);
      highest = std::max(highest, along);
    }
  }
  occupied.push_back({first, static_cast<uint32_t>(blocks.size()) - first, middle,
                      cone_of(normals, axis), slab_of(lowest, highest)});
}

// The largest empty cube ahead of a cell is one larger than the smallest of those of its seven
// neighbours ahead, as it is their union with the cell. Cells are visited against the octant's
// direction, so that what is ahead is known: the layer before in z, and the row before in y. Rows
// have a spare place in front, for what is outside the grid.
void Grid::measure_skips(const std::stop_token& stop) {
  skips.assign(cells.size() * 8 + 3, 1);  // spare bytes, as they are read four at a time
  const auto along = [&](int octant, int axis, int i) {
    return octant >> axis & 1 ? i : size[axis] - 1 - i;
  };
  const auto measure = [&](int octant) {
    constexpr uint8_t kOutside = kMaxSkip - 1;
    const size_t row = static_cast<size_t>(size[0]) + 1;
    std::vector<uint8_t> ahead((size[1] + 1) * row, kOutside), layer = ahead, least(row);
    for (int k = 0; k < size[2]; ++k) {
      for (int j = 0; j < size[1]; ++j) {
        check_cancelled(stop);
        // Rows of the four neighbours at the same place in x, but for this one.
        const uint8_t* const in_z = &ahead[(j + 1) * row];
        const uint8_t* const in_yz = &ahead[j * row];
        const uint8_t* const in_y = &layer[j * row];
        uint8_t* const here = &layer[(j + 1) * row];
        for (size_t i = 0; i < row; ++i) least[i] = std::min({in_z[i], in_yz[i], in_y[i]});
        const size_t first = (static_cast<size_t>(along(octant, 2, k)) * size[1] +
                              static_cast<size_t>(along(octant, 1, j))) *
                             size[0];
        for (size_t i = 1; i < row; ++i) {
          const size_t cell = first + along(octant, 0, static_cast<int>(i) - 1);
          if (cells[cell] & kOccupied) {
            here[i] = 0;
          } else {
            const int skip = std::min({least[i], least[i - 1], here[i - 1]}) + 1;
            skips[cell * 8 + octant] = static_cast<uint8_t>(skip);
            here[i] = static_cast<uint8_t>(std::min<int>(skip, kOutside));
          }
        }
      }
      std::swap(ahead, layer);
    }
  };
  const size_t threads = std::min<size_t>(8, thread_count(0));
  on_threads(threads, [&](size_t thread) {
    for (size_t octant = thread; octant < 8; octant += threads) measure(static_cast<int>(octant));
  });
}

// Whether a line from an empty cell along x leaves the medium where it first crosses the boundary.
// As the cell is empty, any point of it will do: one off the middle, which no edge of a mesh with
// round coordinates is likely to be seen through. Where parts touch, it enters one as it leaves
// another, in whatever order rounding says: such crossings cancel each other.
bool Grid::lies_inside(int x, int y, int z, Cancellation& cancellation) const {
  const Vec3d from{low.x + (x + 0.5) * edge, low.y + (y + 0.6371) * edge,
                   low.z + (z + 0.2823) * edge};
  const double apart = 1e-4 * edge;                  // of faces that do not touch, at least
  std::map<uint32_t, std::pair<double, int>> ahead;  // by triangle: where, and 1 if it is left
  for (; x < size[0]; ++x) {
    const uint32_t word = cells[(static_cast<size_t>(z) * size[1] + y) * size[0] + x];
    if (!(word & kOccupied)) continue;
    const OccupiedCell& cell = occupied[word & kPayload];
    for (uint32_t b = cell.first_block; b < cell.first_block + cell.block_count; ++b) {
      cancellation.turn();
      for (size_t i = 0; i < TriangleBlock::kSize; ++i) {
        const auto corner = [&](size_t k) {
          const auto& lanes = blocks[b].corners[k];
          return Vec3d{lanes[0][i], lanes[1][i], lanes[2][i]} + static_cast<Vec3d>(cell.middle) -
                 from;
        };
        const Vec3d a = corner(0), c = corner(1), e = corner(2);
        // The line passes within if it has the same side of all edges (see `sides` in
        // lines/triangle_test-inl.h), here for the direction (1, 0, 0).
        const double slope = cross(c - a, e - a).x;
        const auto passes = [&](Vec3d p, Vec3d q) { return (p.y * q.z - p.z * q.y) * slope >= 0; };
        if (slope == 0 || !passes(a, c) || !passes(c, e) || !passes(e, a)) continue;
        const double t = dot(cross(c - a, e - a), a) / slope;
        if (t >= 0) ahead[numbers[b][i]] = {t, slope > 0 ? 1 : -1};
      }
    }
    // The first crossings in this cell and before that do not cancel each other.
    const double end = low.x + (x + 1.0) * edge - from.x;
    if (const int left = first_side(ahead, end - apart, apart); left != 0) return left > 0;
  }
  return first_side(ahead, std::numeric_limits<double>::infinity(), apart) > 0;
}

// Empty cells that hang together lie on the same side of the boundary.
void Grid::mark_inside(Cancellation& cancellation) {
  std::vector<bool> visited(cells.size());
  std::vector<uint32_t> pending, component;
  for (uint32_t seed = 0; seed < cells.size(); ++seed) {
    if (visited[seed] || (cells[seed] & kOccupied)) continue;
    component.clear();
    pending = {seed};
    visited[seed] = true;
    while (!pending.empty()) {
      cancellation.turn();
      const uint32_t cell = pending.back();
      pending.pop_back();
      component.push_back(cell);
      const uint32_t row = size[0], layer = row * size[1];
      const uint32_t x = cell % row, y = cell / row % size[1], z = cell / layer;
      const auto visit = [&](bool exists, uint32_t neighbour) {
        if (exists && !visited[neighbour] && !(cells[neighbour] & kOccupied)) {
          visited[neighbour] = true;
          pending.push_back(neighbour);
        }
      };
      visit(x > 0, cell - 1);
      visit(x + 1 < row, cell + 1);
      visit(y > 0, cell - row);
      visit(y + 1 < static_cast<uint32_t>(size[1]), cell + row);
      visit(z > 0, cell - layer);
      visit(z + 1 < static_cast<uint32_t>(size[2]), cell + layer);
    }
    if (lies_inside(static_cast<int>(seed % size[0]), static_cast<int>(seed / size[0] % size[1]),
                    static_cast<int>(seed / size[0] / size[1]), cancellation)) {
      for (const uint32_t at : component) cells[at] |= kInside;
    }
  }
}

size_t Grid::memory() const {
  return cells.size() * sizeof(uint32_t) + skips.size() + occupied.size() * sizeof(OccupiedCell) +
         blocks.size() * (sizeof(TriangleBlock) + sizeof(numbers.front()));
}

}  // namespace itn::tracer
