// A uniform grid over the boundary of the medium. Internal to the tracer.
//
// Walks in a scattering medium make short flights: a query from the root of a tree spends most of
// its time on the way down. In a grid whose cells hold about ten triangles a flight visits one or
// two cells; empty cells say how far the next triangle is, and are crossed in one step.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/mesh.h"

namespace itn::tracer {

// Sixteen triangles, in the form that they are tested in: the corners, and the cross product of two
// edges, which points outward. Places that are not used have a normal of 0, which nothing hits.
struct alignas(64) TriangleBlock {
  static constexpr int kSize = 16;
  using Lane = std::array<float, kSize>;
  Lane corners[3][3]{}, normal[3]{};  // [corner][axis], [axis]
};

// Appends triangles to blocks, opening new ones as needed.
class BlockWriter {
 public:
  explicit BlockWriter(std::vector<TriangleBlock>& blocks) : blocks_(blocks) {}
  // The next triangle begins a new block.
  void begin() { used_ = TriangleBlock::kSize; }
  void add(const Mesh& mesh, uint32_t triangle);

 private:
  std::vector<TriangleBlock>& blocks_;
  int used_ = TriangleBlock::kSize;
};

class Grid {
 public:
  explicit Grid(const Mesh& mesh);

  // A cell's word. Occupied: kOccupied | number n of the cell, whose triangles are in the blocks
  // first_block[n] .. first_block[n + 1] - 1. Empty: Chebyshev distance in cells to the nearest
  // occupied one (at least 1), | kInside if it lies in the medium.
  static constexpr uint32_t kOccupied = 1U << 31, kInside = 1U << 30, kPayload = kInside - 1;

  Vec3f low{};  // corner of the grid
  float edge = 1, inverse_edge = 1;
  std::array<int, 3> size{1, 1, 1};  // in cells
  std::vector<uint32_t> cells;       // x fastest
  std::vector<uint32_t> first_block;
  std::vector<TriangleBlock> blocks;

  size_t memory() const;

 private:
  void choose_cells(const Mesh& mesh);
  void fill(const Mesh& mesh);
  void measure_distances();
  bool lies_inside(int x, int y, int z) const;
  void mark_inside();
};

}  // namespace itn::tracer
