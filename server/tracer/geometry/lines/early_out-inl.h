// Rays that end where they have begun, found out before any line is followed.
#if defined(ITN_TRACER_GEOMETRY_LINES_EARLY_OUT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_LINES_EARLY_OUT_INL_H_
#undef ITN_TRACER_GEOMETRY_LINES_EARLY_OUT_INL_H_
#else
#define ITN_TRACER_GEOMETRY_LINES_EARLY_OUT_INL_H_
#endif

#include <cfloat>
#include <cstddef>
#include <cstdint>

#include "server/tracer/geometry/lines/grid_steps-inl.h"
#include "server/tracer/geometry/lines/surface_search-inl.h"
#include "server/tracer/geometry/obstacles.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Lines start a little behind their origin (rule 3 of geometry/line_geometry.h).
struct Start {
  Floats slack, distance;
  Vectors origin;
};
HWY_INLINE Start start_of(const Obstacles& obstacles, Vectors position, Vectors direction) {
  const Floats reach =
      hn::Max(hn::Abs(position.x), hn::Max(hn::Abs(position.y), hn::Abs(position.z)));
  const Floats slack = 4 * FLT_EPSILON * hn::Max(set(obstacles.extent), reach);
  const Floats distance = slack + slack;
  return {slack, distance, position - direction * distance};
}

// Whether what the grid knows allows that points lie in the medium, given the cell's word.
HWY_INLINE Mask may_be_inside(const Obstacles& obstacles, Vectors p, Uints word) {
  const Mask allowed = not_zero(word & set(Grid::kOccupied | Grid::kInside));
  const float margin = 16 * FLT_EPSILON * obstacles.extent;
  const auto within = [&](Floats x, float low, float high) {
    return (x >= low - margin) & (x <= high + margin);
  };
  const Bounds& box = obstacles.bounds;
  return allowed & within(p.x, box.min.x, box.max.x) & within(p.y, box.min.y, box.max.y) &
         within(p.z, box.min.z, box.max.z);
}

// Finds the rays among i, i + 1 ... that are asked for, start inside and end in the medium without
// leaving their first cell or cube.
inline Mask end_in_first_cell(const Obstacles& obstacles, Rays& rays, Report report, size_t i,
                              Mask asked) {
  const FloatTag d;
  const Grid& grid = obstacles.grid;
  const Vectors position = load(rays.position, i);
  const Vectors direction = with_positive_zeros(load(rays.direction, i));
  const Floats max_medium_length = load(rays.max_medium_length, i);
  const auto [slack, start, origin] = start_of(obstacles, position, direction);
  const Floats end = start + max_medium_length;
  const Vectors stop = origin + direction * end;

  const Vectors x0 = in_cells(grid, origin), dx = direction * set(grid.inverse_edge);
  const Vectors cell{cell_at(x0.x, dx.x, slack, grid.size[0]),
                     cell_at(x0.y, dx.y, slack, grid.size[1]),
                     cell_at(x0.z, dx.z, slack, grid.size[2])};
  const auto [word, reach] = read_cell(grid, cell, octant_of(direction));
  // The end lies in the cube ahead.
  const auto within = [&, reach = reach](Floats c, Floats from, Floats slope) {
    const Floats to = mul_add(slope, end, from) - c;
    const Mask falls = slope < 0;
    const Floats ahead = hn::IfThenElse(falls, 1 - to, to);
    return (ahead >= 0) & (ahead <= reach);
  };
  Mask done =
      asked & within(cell.x, x0.x, dx.x) & within(cell.y, x0.y, dx.y) & within(cell.z, x0.z, dx.z);
  const Mask occupied = done & not_zero(word & set(Grid::kOccupied));
  if (!hn::AllFalse(d, occupied)) {
    const Passage passage{origin, direction, set(1.0F), slack, end};
    done = hn::AndNot(may_cross(grid, word, occupied, cell, passage), done);
  }
  done &= may_be_inside(obstacles, stop, word);
  if (!obstacles.surfaces.empty()) {
    done = hn::AndNot(
        may_hit_surfaces(obstacles.surfaces, position, direction, max_medium_length, slack), done);
  }
  if (hn::AllFalse(d, done)) return done;
  store(hn::IfThenElse(done, max_medium_length, load(rays.medium_length, i)), rays.medium_length,
        i);
  const Uints outcome = set(Rays::kInMedium | Rays::kEntered), inside = set(Rays::kInside);
  store(hn::IfThenElse(for_uints(done), outcome, load(rays.outcome, i)), rays.outcome, i);
  if (report == Report::kEnds) {
    store(if_then_else(done, stop, position), rays.position, i);
    store(hn::IfThenElse(for_uints(done), inside, load(rays.interaction, i)), rays.interaction, i);
  }
  return done;
}

// Most flights in a thick medium, and many shadow rays, end where they have begun: in the same
// empty cube, or in an occupied cell without coming near its triangles. These are found out in
// the order of the rays, a vector at a time, and are done; the numbers of the others, which are
// left to be followed, are put into `pending`. Returns how many those are.
HWY_INLINE size_t early_out(const Obstacles& obstacles, Rays& rays, size_t count, Report report,
                            UintColumn& pending) {
  const FloatTag d;
  size_t pending_count = 0;
  for (size_t i = 0; i < count; i += lanes()) {
    const Mask live = hn::FirstN(d, count - i);
    const Mask inside = is_inside(load(rays.interaction, i));
    Mask done = live & inside;
    if (rays.bounded) {
      done &= load(rays.max_medium_length, i) <= load(rays.distance, i);
    }
    if (!hn::AllFalse(d, done)) done = end_in_first_cell(obstacles, rays, report, i, done);
    const Uints number = hn::Iota(UintTag(), 0) + set(static_cast<uint32_t>(i));
    hn::CompressStore(number, for_uints(hn::AndNot(done, live)), UintTag(),
                      pending.data() + pending_count);
    pending_count += hn::CountTrue(d, hn::AndNot(done, live));
  }
  return pending_count;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
