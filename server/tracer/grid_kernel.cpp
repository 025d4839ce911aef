// Queries against blocks of triangles and against the grid, compiled once for every instruction set
// that Highway knows and chosen at run time. Multiplications and additions are not contracted
// (-ffp-contract=off), so that every width computes the same bits.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/tracer/grid_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h:
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cfloat>
#include <cmath>
#include <limits>

#include "server/tracer/grid.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, TriangleBlock::kSize>;

// Which sides of a triangle count.
enum class Side { kLeaving, kEntering, kBoth };

// A line, and the closest hit on it so far.
struct Query {
  const Line& line;
  float t_min;
  Side side;
  Hit hit;  // hit.t: closest so far, or the end of the query
};

// Tests a block. Seen from the origin, with corners A, B, C relative to it and n = (B - A) x (C -
// A), the line meets the triangle if
//   d . (B x C),  d . (C x A),  d . (A x B),
// whose sum is D = n . d, all have the sign of D; D > 0 where the line leaves. The distance is
// n . A / D. Each of the three belongs to an edge, and swapping the edge's ends negates it exactly:
// two triangles that share an edge agree on which side of it the line passes, and none slips
// between (the signs are those of the Pluecker coordinates of the line and the edges).
HWY_INLINE void test_block(const TriangleBlock& block, Query& query) {
  const Floats d;
  const auto load = [&](const TriangleBlock::Lane& lane, int i) {
    return hn::Load(d, lane.data() + i);
  };
  const auto set = [&](float v) { return hn::Set(d, v); };
  const Vec3f o = query.line.origin, w = query.line.direction;
  const auto ox = set(o.x), oy = set(o.y), oz = set(o.z);
  const auto dx = set(w.x), dy = set(w.y), dz = set(w.z);
  const auto zero = hn::Zero(d);
  const auto dot3 = [](auto ax, auto ay, auto az, auto bx, auto by, auto bz) {
    return hn::Add(hn::Add(hn::Mul(ax, bx), hn::Mul(ay, by)), hn::Mul(az, bz));
  };
  const auto minus_product = [](auto a, auto b, auto c, auto e) {  // a b - c e
    return hn::Sub(hn::Mul(a, b), hn::Mul(c, e));
  };
  const auto volume = [&](auto ax, auto ay, auto az, auto bx, auto by, auto bz) {  // d . (a x b)
    return dot3(dx, dy, dz, minus_product(ay, bz, az, by), minus_product(az, bx, ax, bz),
                minus_product(ax, by, ay, bx));
  };
  for (int i = 0; i < TriangleBlock::kSize; i += static_cast<int>(hn::Lanes(d))) {
    const auto nx = load(block.normal[0], i), ny = load(block.normal[1], i),
               nz = load(block.normal[2], i);
    const auto determinant = dot3(nx, ny, nz, dx, dy, dz);
    // Flips signs so that what counts has D > 0.
    const auto sign = query.side == Side::kLeaving    ? set(1)
                      : query.side == Side::kEntering ? set(-1)
                                                      : hn::CopySign(set(1), determinant);
    const auto size = hn::Mul(determinant, sign);

    const auto corner = [&](int k, int axis, auto origin) {
      return hn::Sub(load(block.corners[k][axis], i), origin);
    };
    const auto ax = corner(0, 0, ox), ay = corner(0, 1, oy), az = corner(0, 2, oz);
    const auto bx = corner(1, 0, ox), by = corner(1, 1, oy), bz = corner(1, 2, oz);
    const auto cx = corner(2, 0, ox), cy = corner(2, 1, oy), cz = corner(2, 2, oz);
    const auto least = hn::Min(hn::Mul(sign, volume(bx, by, bz, cx, cy, cz)),
                               hn::Min(hn::Mul(sign, volume(cx, cy, cz, ax, ay, az)),
                                       hn::Mul(sign, volume(ax, ay, az, bx, by, bz))));
    const auto within = hn::And(hn::Gt(size, zero), hn::Ge(least, zero));
    if (HWY_LIKELY(hn::AllFalse(d, within))) {
      continue;
    }
    const auto t = hn::Div(hn::Mul(sign, dot3(nx, ny, nz, ax, ay, az)), size);
    const auto hits =
        hn::And(within, hn::And(hn::Ge(t, set(query.t_min)), hn::Le(t, set(query.hit.t))));
    if (hn::AllFalse(d, hits)) {
      continue;
    }
    HWY_ALIGN float distances[TriangleBlock::kSize];
    hn::Store(t, d, distances);
    uint8_t bits[8] = {};
    hn::StoreMaskBits(d, hits, bits);
    for (uint32_t mask = bits[0] | static_cast<uint32_t>(bits[1]) << 8; mask != 0;
         mask &= mask - 1) {
      const int lane = std::countr_zero(mask);
      const SurfaceTriangle at{block.surface[i + lane], block.triangle[i + lane]};
      const bool excluded = at.surface == query.line.excluded.surface &&
                            at.triangle == query.line.excluded.triangle &&
                            at.surface != SurfaceTriangle::kNone;
      if (distances[lane] <= query.hit.t && !excluded) {
        query.hit.t = distances[lane];
        query.hit.found = true;
        query.hit.surface = at;
      }
    }
  }
}

Hit in_blocks(const std::vector<TriangleBlock>& blocks, const Line& line, float t_min,
              float t_max) {
  Query query{line, t_min, Side::kBoth, {}};
  query.hit.t = t_max;
  for (const TriangleBlock& block : blocks) {
    test_block(block, query);
  }
  return query.hit;
}

// A line's progress along one axis of the grid. Face f of the cells is met at distance f * slope +
// offset.
struct Axis {
  float slope, offset;
  int sign;   // +1 or -1
  int ahead;  // face of a cell that the line leaves through, relative to the cell, for reach 0

  // A component of 0 is taken as so small that its faces are never met first.
  Axis(float low, float edge, float origin, float direction) {
    constexpr float kTiny = 1e-20F;
    const float inverse =
        1 / (std::abs(direction) < kTiny ? std::copysign(kTiny, direction) : direction);
    slope = edge * inverse;
    offset = (low - origin) * inverse;
    sign = direction < 0 ? -1 : 1;
    ahead = direction < 0 ? 1 : 0;
  }
  // Where the line leaves the cube of cells less than `reach` away from `cell`.
  float leave(int cell, int reach) const {
    return static_cast<float>(cell + ahead + sign * reach) * slope + offset;
  }
};

// Walks from cell to cell. A step leaves the cube of empty cells around the current one, whose half
// edge is the distance that the cell holds (1 for an occupied cell: the cell itself), through the
// face that the line meets first. The index along that axis is set from the cube, so every step
// makes progress however the distance is rounded; the others follow from the position.
Hit in_grid(const Grid& grid, const Line& line, float t_min, float t_max, Wanted wanted) {
  const Axis axes[3] = {{grid.low.x, grid.edge, line.origin.x, line.direction.x},
                        {grid.low.y, grid.edge, line.origin.y, line.direction.y},
                        {grid.low.z, grid.edge, line.origin.z, line.direction.z}};
  // Clip to the grid.
  float t = t_min, end = t_max;
  for (int i = 0; i < 3; ++i) {
    const float a = axes[i].offset;
    const float b = static_cast<float>(grid.size[i]) * axes[i].slope + axes[i].offset;
    t = std::max(t, std::min(a, b));
    end = std::min(end, std::max(a, b));
  }
  if (!(t <= end)) {
    return {};
  }

  // In cells from the grid's corner.
  const float x0 = (line.origin.x - grid.low.x) * grid.inverse_edge,
              y0 = (line.origin.y - grid.low.y) * grid.inverse_edge,
              z0 = (line.origin.z - grid.low.z) * grid.inverse_edge;
  const float dx = line.direction.x * grid.inverse_edge, dy = line.direction.y * grid.inverse_edge,
              dz = line.direction.z * grid.inverse_edge;
  const auto clamped = [](float position, int low, int high) {
    return std::clamp(static_cast<int>(position), low, high);  // what is below 0 becomes 0
  };
  int x = clamped(x0 + dx * t, 0, grid.size[0] - 1), y = clamped(y0 + dy * t, 0, grid.size[1] - 1),
      z = clamped(z0 + dz * t, 0, grid.size[2] - 1);

  Query query{line, t_min, wanted == Wanted::kExit ? Side::kLeaving : Side::kEntering, {}};
  query.hit.t = t_max;
  const uint32_t* const cells = grid.cells.data();
  const int row = grid.size[0], layer = grid.size[0] * grid.size[1];
  uint32_t word = cells[z * layer + y * row + x];
  query.hit.leaked = wanted == Wanted::kExit && !(word & (Grid::kOccupied | Grid::kInside));
  for (;;) {
    int reach = 1;
    if (word & Grid::kOccupied) {
      const uint32_t n = word & Grid::kPayload;
      for (uint32_t b = grid.first_block[n]; b < grid.first_block[n + 1]; ++b) {
        test_block(grid.blocks[b], query);
      }
    } else {
      reach = static_cast<int>(word & Grid::kPayload);
    }
    const float leave_x = axes[0].leave(x, reach), leave_y = axes[1].leave(y, reach),
                leave_z = axes[2].leave(z, reach);
    const float leave = std::min(leave_x, std::min(leave_y, leave_z));
    if (leave >= std::min(query.hit.t, end)) {
      break;
    }
    const auto follow = [&](int cell, float position, int size) {
      return clamped(position, std::max(0, cell - reach + 1), std::min(size - 1, cell + reach - 1));
    };
    if (leave == leave_x) {
      x += axes[0].sign * reach;
      y = follow(y, y0 + dy * leave, grid.size[1]);
      z = follow(z, z0 + dz * leave, grid.size[2]);
      if (static_cast<unsigned>(x) >= static_cast<unsigned>(grid.size[0])) {
        break;
      }
    } else if (leave == leave_y) {
      y += axes[1].sign * reach;
      x = follow(x, x0 + dx * leave, grid.size[0]);
      z = follow(z, z0 + dz * leave, grid.size[2]);
      if (static_cast<unsigned>(y) >= static_cast<unsigned>(grid.size[1])) {
        break;
      }
    } else {
      z += axes[2].sign * reach;
      x = follow(x, x0 + dx * leave, grid.size[0]);
      y = follow(y, y0 + dy * leave, grid.size[1]);
      if (static_cast<unsigned>(z) >= static_cast<unsigned>(grid.size[2])) {
        break;
      }
    }
    word = cells[z * layer + y * row + x];
  }
  if (!query.hit.found) {
    query.hit.t = std::numeric_limits<float>::infinity();
  }
  return query.hit;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(in_blocks);
HWY_EXPORT(in_grid);

Hit closest_in_blocks(const std::vector<TriangleBlock>& blocks, const Line& line, float t_min,
                      float t_max) {
  return HWY_DYNAMIC_DISPATCH(in_blocks)(blocks, line, t_min, t_max);
}

Hit closest_in_grid(const Grid& grid, const Line& line, float t_min, float t_max, Wanted wanted) {
  return HWY_DYNAMIC_DISPATCH(in_grid)(grid, line, t_min, t_max, wanted);
}

}  // namespace itn::tracer
#endif
