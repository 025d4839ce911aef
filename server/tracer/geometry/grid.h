// A uniform grid over the boundary of the medium. Internal to the tracer.
//
// Walks in a scattering medium make short flights: a query from the root of a tree spends most of
// its time on the way down. In a grid whose cells hold about ten triangles a flight visits one or
// two cells; empty cells say how far it is to the next triangle, and are crossed in one step.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "common/cancellation.h"
#include "common/geometry/mesh.h"

namespace itn::tracer {

// Sixteen triangles: their corners, counter-clockwise seen from outside, relative to the middle of
// the cell that they are tested for, so that they are small numbers. Places that are not used have
// all corners at 0, and are never hit.
struct alignas(64) TriangleBlock {
  static constexpr int kSize = 16;
  using Lane = std::array<float, kSize>;
  Lane corners[3][3]{};  // [corner][axis]
};

// An occupied cell.
struct OccupiedCell {
  uint32_t first_block, block_count;
  Vec3f middle;
  // Tells where lines need not look for crossings. The signed bytes a_x, a_y, a_z are an axis,
  // about the mean of the normals n of its triangles, and the byte above them a threshold T, such
  // that |d . a| >= T means that n . d has the sign of a . d for all of them; 255 if there is none.
  uint32_t normals;
  // All of its triangles lie in the slab low <= a . (x - middle) <= high: two numbers of 16 bits,
  // low in the lower half, that stand for -1 .. 1 times Grid::slab_scale.
  uint32_t slab;
};

class Grid {
 public:
  // The mesh has a triangle, and is longer than 0. Throws Error: kCancelled soon after a stop is
  // asked for; kLimit for more than kMaxTriangles.
  explicit Grid(const Mesh& mesh, const std::stop_token& stop = {});

  static constexpr size_t kMaxTriangles = size_t{1} << 28;
  // What a grid of this many triangles takes at most while it is built, in bytes, of whatever shape
  // they are; built, it takes no more either.
  static size_t most_memory(size_t triangles);

  // A cell's word. Occupied: kOccupied | its number among them. Empty: kInside if it lies in the
  // medium.
  static constexpr uint32_t kOccupied = 1U << 31, kInside = 1U << 30, kPayload = kInside - 1;

  Vec3f low{};  // corner of the grid
  float edge = 1, inverse_edge = 1;
  std::array<int, 3> size{1, 1, 1};  // in cells
  float slab_scale = 1;              // above all a . (x - middle) of a cell
  // The object is thin and wide: where lines cross a triangle is computed in double precision, as
  // the coordinates of its corners are many times what matters.
  bool is_thin = false;
  std::vector<uint32_t> cells;  // x fastest
  // For every cell and octant of directions, the edge in cells of the largest empty cube that has
  // the cell in its corner and reaches ahead, at most kMaxSkip; what lies outside the grid is
  // empty. Eight bytes a cell, by octant: bit 0 set if x falls, 1 if y, 2 if z. 1 for occupied
  // cells. A line that leaves the object is out of the grid in a step or two.
  std::vector<uint8_t> skips;
  static constexpr int kMaxSkip = 255;
  std::vector<OccupiedCell> occupied;
  std::vector<TriangleBlock> blocks;
  // The numbers that the triangles of a block have in the mesh.
  std::vector<std::array<uint32_t, TriangleBlock::kSize>> numbers;

  size_t memory() const;

 private:
  struct Touched;
  void choose_cells(const Mesh& mesh, Cancellation& cancellation);
  void place_cells(const Bounds& box, double cell);
  std::optional<Touched> touched_cells(const Mesh& mesh, Cancellation& cancellation);
  void fill(const Mesh& mesh, Cancellation& cancellation);
  void add_cell(const Mesh& mesh, size_t cell_index, std::span<const uint32_t> triangles,
                Cancellation& cancellation);
  void measure_skips(const std::stop_token& stop);
  bool lies_inside(int x, int y, int z, Cancellation& cancellation) const;
  void mark_inside(Cancellation& cancellation);
};

}  // namespace itn::tracer
