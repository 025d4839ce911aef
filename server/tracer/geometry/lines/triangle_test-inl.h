// Which triangles of their cells lines cross. They are tested for one line at a time, as many at
// once as there are lanes: neighbouring lines do not look at the same cells.
#if defined(ITN_TRACER_GEOMETRY_LINES_TRIANGLE_TEST_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_LINES_TRIANGLE_TEST_INL_H_
#undef ITN_TRACER_GEOMETRY_LINES_TRIANGLE_TEST_INL_H_
#else
#define ITN_TRACER_GEOMETRY_LINES_TRIANGLE_TEST_INL_H_
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/tracer/geometry/grid.h"
#include "server/tracer/geometry/lines/lines-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The test is that of Woop, Benthin and Wald, "Watertight ray/triangle intersection", JCGT 2013:
// space is sheared along the line, so that the line becomes parallel to the axis z that it is
// nearest to. All is relative to the point c of the line next to the middle of the cell, so that
// numbers are small. To find entries, the line is turned around, which swaps x and y.
struct Shear {
  uint32_t x, y, z;     // axes
  float by_x, by_y;     // how far the line goes along x and y while it advances by 1 along z
  float c_x, c_y, c_z;  // c, the first two sheared
  float to_c, per_z;    // distance of c; of points beyond it, by their z
};
HWY_INLINE Shear shear_along(const Lines& lines, int line, Vec3f middle) {
  const Vec3f o = lines.origin.at(line) - middle, d = lines.direction.at(line);
  const float to_c = -itn::dot(o, d);
  const Vec3f c = o + d * to_c;
  const float slopes[] = {d.x, d.y, d.z}, from[] = {c.x, c.y, c.z};
  const uint32_t z = lines.steepest[line];
  const bool swap = (slopes[z] < 0) != (lines.side[line] < 0);
  const uint32_t x = (z + (swap ? 2 : 1)) % 3, y = (z + (swap ? 1 : 2)) % 3;
  const float per_z = 1 / slopes[z], by_x = slopes[x] * per_z, by_y = slopes[y] * per_z;
  return {.x = x,
          .y = y,
          .z = z,
          .by_x = by_x,
          .by_y = by_y,
          .c_x = from[x] - by_x * from[z],
          .c_y = from[y] - by_y * from[z],
          .c_z = from[z],
          .to_c = to_c,
          .per_z = per_z};
}

// On which side of the edges of triangles i, i + 1 ... of a block the line passes: of an edge PQ,
// by the sign of P_x Q_y - P_y Q_x. It crosses a triangle from inside out if all three are
// positive. Swapping the ends of an edge negates this exactly: two triangles that share an edge
// agree on which side of it the line passes, and none slips between.
struct Sides {
  Floats u, v, w;
};
HWY_INLINE Sides sides(const TriangleBlock& block, size_t i, const Shear& shear) {
  struct Point {
    Floats x, y;
  };
  const auto corner = [&](size_t k) {
    const auto along = [&](uint32_t axis) {
      return hn::Load(FloatTag(), block.corners[k][axis].data() + i);
    };
    const Floats z = along(shear.z);
    return Point{mul_add(set(-shear.by_x), z, along(shear.x)) - shear.c_x,
                 mul_add(set(-shear.by_y), z, along(shear.y)) - shear.c_y};
  };
  const auto side = [](Point from, Point to) { return from.x * to.y - from.y * to.x; };
  const Point p = corner(0), q = corner(1), r = corner(2);
  return {side(q, r), side(r, p), side(p, q)};
}

template <typename AtBoundary>
class TriangleTest {
 public:
  using LineCrossings = typename AtBoundary::LineCrossings;

  // Tests the triangles of the cells that lines have reached, for the nearest crossing between
  // Lines::t_min and the end of the query or an earlier hit. First all are tested without a branch,
  // as the processor would guess it wrong half of the time; then the distances of those that are
  // hit are computed.
  HWY_INLINE void test(const Grid& grid, Lines& lines, LineCrossings& crossings, LineBits which) {
    const FloatTag tag;
    size_t passed = 0;
    for (; which != 0; which &= which - 1) {
      const int line = std::countr_zero(which);
      const OccupiedCell& cell = grid.occupied[lines.word[line] & Grid::kPayload];
      const Shear shear = shear_along(lines, line, cell.middle);
      for (uint32_t b = cell.first_block; b < cell.first_block + cell.block_count; ++b) {
        const TriangleBlock& block = grid.blocks[b];
        for (size_t i = 0; i < TriangleBlock::kSize; i += lanes()) {
          const auto [u, v, w] = sides(block, i, shear);
          const Mask within = (hn::Min(u, hn::Min(v, w)) >= 0) & (hn::Max(u, hn::Max(v, w)) > 0);
          Passed& entry = passed_[passed];
          entry.line = line;
          entry.hits = bits_of(within);
          hn::Store(u, tag, entry.sides[0].data());
          hn::Store(v, tag, entry.sides[1].data());
          hn::Store(w, tag, entry.sides[2].data());
          for (size_t k = 0; k < 3; ++k) entry.depth_grid[k] = block.corners[k][shear.z].data() + i;
          entry.c_z = shear.c_z;
          entry.per_z = shear.per_z;
          entry.to_c = shear.to_c;
          entry.first = b * TriangleBlock::kSize + static_cast<uint32_t>(i);
          passed += entry.hits != 0 ? 1 : 0;
          if (passed == kPassed) {
            measure_hits(grid, lines, crossings, passed);
            passed = 0;
          }
        }
      }
    }
    measure_hits(grid, lines, crossings, passed);
  }

 private:
  // How far along a line the plane of a triangle is, in mm: exact but for the rounding of the line.
  static float distance_to_plane(const Grid& grid, const Lines& lines, int line,
                                 uint32_t triangle) {
    const TriangleBlock& block = grid.blocks[triangle / TriangleBlock::kSize];
    const auto corner = [&](size_t k) {
      const auto& axes = block.corners[k];
      const uint32_t lane = triangle % TriangleBlock::kSize;
      return Vec3d{double{axes[0][lane]}, double{axes[1][lane]}, double{axes[2][lane]}};
    };
    const Vec3f middle = grid.occupied[lines.word[line] & Grid::kPayload].middle;
    const Vec3d a = corner(0), n = itn::cross(corner(1) - a, corner(2) - a);
    const Vec3d from = static_cast<Vec3d>(lines.origin.at(line)) - static_cast<Vec3d>(middle);
    return static_cast<float>(itn::dot(n, a - from) /
                              itn::dot(n, static_cast<Vec3d>(lines.direction.at(line))));
  }

  // The three sides of a triangle that is hit are the barycentric coordinates of the crossing,
  // times a common factor.
  HWY_INLINE void measure_hits(const Grid& grid, Lines& lines,
                               [[maybe_unused]] LineCrossings& crossings, size_t count) {
    for (const Passed* entry = passed_; entry < passed_ + count; ++entry) {
      const int line = entry->line;
      for (LineBits bits = entry->hits; bits != 0; bits &= bits - 1) {
        const auto i = static_cast<uint32_t>(std::countr_zero(bits));
        const float u = entry->sides[0][i], v = entry->sides[1][i], w = entry->sides[2][i];
        const float z = (u * entry->depth_grid[0][i] + v * entry->depth_grid[1][i] +
                         w * entry->depth_grid[2][i]) /
                        (u + v + w);
        const float t = grid.is_thin ? distance_to_plane(grid, lines, line, entry->first + i)
                                     : entry->to_c + (z - entry->c_z) * entry->per_z;
        const float end = std::min(lines.end[line], lines.hit[line]);
        if constexpr (AtBoundary::kStops) {
          if (t >= lines.t_min[line] && t <= end) {
            crossings.hit[line] = entry->first + i;
            crossings.cell[line] = lines.word[line] & Grid::kPayload;
            crossings.sides.set(line, {u, v, w});
          }
        }
        lines.hit[line] = t >= lines.t_min[line] && t <= end ? t : lines.hit[line];
      }
    }
  }

  // Parts of blocks whose triangles are tested before their hits are measured.
  static constexpr size_t kPassed = 32;

  // Such a part, with triangles that a line passes within.
  struct Passed {
    alignas(64) std::array<float, kMaxLanes> sides[3];
    LineBits hits;
    int line;
    uint32_t first;                          // of its triangles, as its block * kSize + place in it
    std::array<const float*, 3> depth_grid;  // of the corners, along the axis nearest to the line
    float c_z, per_z, to_c;                  // t = to_c + (z - c_z) per_z
  };
  Passed passed_[kPassed];
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
