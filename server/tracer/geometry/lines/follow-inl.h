// Follows many straight lines at a time through the medium, the surfaces and out of the scene: the
// rules are those of Geometry::follow (geometry/line_geometry.h), line by line.
//
// A line is a sequence of queries: inside the medium for its next exit, outside for its next entry.
// A query steps from cell to cell of the grid (grid_steps-inl.h). kLines of them step at a time,
// several vectors full, so that the processor has other work while one waits for memory. A line
// whose query has ended waits until most of them have, then all that wait take their turn: the
// crossing is booked, and the next query of the line or a new line begins. Triangles are tested for
// one line at a time (triangle_test-inl.h).
#if defined(ITN_TRACER_GEOMETRY_LINES_FOLLOW_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_LINES_FOLLOW_INL_H_
#undef ITN_TRACER_GEOMETRY_LINES_FOLLOW_INL_H_
#else
#define ITN_TRACER_GEOMETRY_LINES_FOLLOW_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/tracer/geometry/lines/early_out-inl.h"
#include "server/tracer/geometry/lines/grid_steps-inl.h"
#include "server/tracer/geometry/lines/surface_search-inl.h"
#include "server/tracer/geometry/lines/triangle_test-inl.h"
#include "server/tracer/geometry/obstacles.h"
#include "server/tracer/geometry/surface_normals-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The state machine of the lines. A line is free; or busy with a ray, and then either its query is
// stepping, or it waits for its turn: for the crossing to be booked, and for the next query.
template <typename AtBoundary>
class LineFollower {
 public:
  LineFollower(const Obstacles& obstacles, Rays& rays, size_t count, Report report,
               Crossings* at_boundary)
      : obstacles_(obstacles),
        grid_(obstacles.grid),
        rays_(rays),
        count_(count),
        report_(report),
        at_boundary_(at_boundary) {}

  void run() {
    // What ends where it begins needs no line.
    pending_count_ = early_out(obstacles_, rays_, count_, report_, pending_);
    for (;;) {
      const LineBits waiting = busy_ & ~stepping_;
      for (size_t v = 0; v < kLines; v += lanes()) {
        if (any_set(waiting, v)) conclude(mask_of(waiting, v), v);
      }
      const LineBits fresh = take_rays();
      if (busy_ == 0) return;
      const LineBits turning = fresh | (waiting & busy_);
      for (size_t v = 0; v < kLines; v += lanes()) {
        if (any_set(fresh, v)) begin_lines(mask_of(fresh, v), v);
        if (any_set(turning, v)) begin_queries(mask_of(turning, v), v);
      }
      const int enough = next_ < pending_count_ ? kLines / 4 : 0;
      while (std::popcount(stepping_) > enough) step();
    }
  }

 private:
  // Gives the next rays to lines that are free; returns the lines that got one.
  LineBits take_rays() {
    LineBits taken = 0;
    for (LineBits free = kAllLines & ~busy_; free != 0 && next_ < pending_count_;
         free &= free - 1) {
      const int line = std::countr_zero(free);
      lines_.ray[line] = pending_[next_++];
      taken |= LineBits{1} << line;
    }
    busy_ |= taken;
    return taken;
  }

  // What lines know of the rays that they were given.
  void begin_lines(Mask fresh, size_t v) {
    const Ints ray = hn::BitCast(IntTag(), load(lines_.ray, v));
    const Vectors position = gather(rays_.position, ray);
    const Vectors direction = with_positive_zeros(gather(rays_.direction, ray));
    const auto [slack, start, origin] = start_of(obstacles_, position, direction);
    lines_.origin.store(fresh, origin, v);
    lines_.direction.store(fresh, direction, v);
    store(fresh, slack, lines_.slack, v);
    store(fresh, start, lines_.t, v);
    const Floats zero = hn::Zero(FloatTag());
    store(fresh, zero, lines_.medium_length, v);
    store(fresh, zero, lines_.last_exit, v);
    store(fresh, zero, lines_.last_entry, v);
    const Floats max_medium_length = gather(rays_.max_medium_length, ray);
    store(fresh, max_medium_length, lines_.max_medium_length, v);
    if (rays_.bounded) store(fresh, start + gather(rays_.distance, ray), lines_.reach, v);
    const Uints interaction = gather(rays_.interaction, ray);
    const Uints inside = interaction & set(Rays::kInside);
    store(fresh, inside, lines_.inside, v);
    store(fresh, inside, lines_.entered, v);
    store(fresh, slack, lines_.first, v);
    if constexpr (AtBoundary::kStops) {
      const uint32_t just_inside = Rays::kInside | Rays::kAtBoundary;
      const Mask ahead = equals(interaction & set(just_inside), just_inside);
      store(fresh & ahead, start + slack, lines_.first, v);
      line_crossings_.start_normal.store(fresh, gather(rays_.normal, ray), v);
    }
    store(fresh, hn::Zero(UintTag()), lines_.crossings, v);

    begin_in_grid(grid_, lines_, fresh, v, origin, direction);
    const Floats x = hn::Abs(direction.x), y = hn::Abs(direction.y), z = hn::Abs(direction.z);
    const Uints zero_or_one = hn::IfThenElseZero(for_uints(y > x), set(uint32_t{1}));
    store(fresh, hn::IfThenElse(for_uints(z > hn::Max(x, y)), set(uint32_t{2}), zero_or_one),
          lines_.steepest, v);

    store(fresh, set(kInfinity), lines_.surface_t, v);
    store(fresh, set(Surfaces::kNone), lines_.surface, v);
    if (!obstacles_.surfaces.empty()) {
      begin_surfaces(obstacles_.surfaces, lines_, fresh, v, position, direction, max_medium_length,
                     interaction);
    }
  }

  // Up to where crossings come before the surface: rule 5 of geometry/line_geometry.h.
  HWY_INLINE Floats last_before_surface(Mask inside, size_t v) const {
    const Floats surface_t = load(lines_.surface_t, v), slack = load(lines_.slack, v);
    if constexpr (!AtBoundary::kStops) return surface_t;
    return surface_t + hn::IfThenElse(inside, slack, -slack);
  }

  // The next query of lines: inside for an exit within the rest of the budget, outside for an
  // entry, both up to the surface.
  void begin_queries(Mask where, size_t v) {
    const FloatTag d;
    const Mask inside = not_zero(load(lines_.inside, v));
    if (!obstacles_.surfaces.empty()) {
      find_surfaces(obstacles_.surfaces, lines_, hn::AndNot(inside, where), v);
    }
    const Floats t = load(lines_.t, v);
    const Floats last =
        hn::IfThenElse(inside, load(lines_.last_exit, v), load(lines_.last_entry, v));
    // The next larger float: these are not negative.
    const Floats beyond = hn::BitCast(d, hn::BitCast(UintTag(), last) + set(uint32_t{1}));
    const Floats t_min = hn::Max(t - load(lines_.slack, v), beyond);
    const Floats rest = t + (load(lines_.max_medium_length, v) - load(lines_.medium_length, v));
    Floats end =
        hn::Min(last_before_surface(inside, v), hn::IfThenElse(inside, rest, set(kInfinity)));
    if (rays_.bounded) end = hn::Min(end, load(lines_.reach, v));
    store(where, t_min, lines_.t_min, v);
    store(where, end, lines_.end, v);
    store(where, set(kInfinity), lines_.hit, v);
    store(where, hn::IfThenElse(inside, set(1.0F), set(-1.0F)), lines_.side, v);
    // Counts as inside until a cell says otherwise.
    store(where, set(Grid::kInside), lines_.word, v);

    stepping_ |= bits_of(enter_grid(grid_, lines_, where, v, t_min, end), v);
  }

  // All lines under way look at the cell that they are in, and take a step.
  HWY_INLINE void step() {
    LineBits to_test = 0;
    for (size_t v = 0; v < kLines; v += lanes()) {
      if (any_set(stepping_, v))
        to_test |= bits_of(read_cells(grid_, lines_, mask_of(stepping_, v), v), v);
    }
    triangle_test_.test(grid_, lines_, line_crossings_, to_test);
    LineBits stepping = 0;
    for (size_t v = 0; v < kLines; v += lanes()) {
      if (any_set(stepping_, v)) {
        stepping |= bits_of(advance(grid_, lines_, mask_of(stepping_, v), v), v);
      }
    }
    stepping_ = stepping;
  }

  // Whether lines from the boundary have met a part that touches theirs: rule 4 of
  // geometry/line_geometry.h.
  HWY_INLINE Mask meets_other_part(Mask crossed, size_t v) const {
    const Floats first = load(lines_.first, v);
    const Mask beside = crossed & (load(lines_.hit, v) <= first) & (first > load(lines_.slack, v));
    const Floats same_way =
        dot(line_crossings_.normal.load(v), line_crossings_.start_normal.load(v));
    return beside & (same_way < kOtherWay);
  }

  // Books what queries have found: goes on to the next query of the line, or ends it.
  void conclude(Mask where, size_t v) {
    const FloatTag d;
    const Mask inside = not_zero(load(lines_.inside, v));
    const Floats hit = load(lines_.hit, v), surface_t = load(lines_.surface_t, v),
                 t = load(lines_.t, v);
    const Floats before_surface = last_before_surface(inside, v);
    Mask crossed = where & (hit < hn::Min(before_surface, set(kInfinity)));
    if constexpr (AtBoundary::kStops) {
      locate(crossed, v);
      const Mask passes = meets_other_part(crossed, v);
      store(passes, hit, lines_.last_exit, v);
      where = hn::AndNot(passes, where);
      crossed = hn::AndNot(passes, crossed);
    }
    const Mask missed = hn::AndNot(crossed, where);

    const Mask exits = crossed & inside, entries = hn::AndNot(inside, crossed);
    const Floats query_end = load(lines_.end, v);
    const Mask at_surface = missed & hn::Eq(query_end, before_surface) & (surface_t < kInfinity);
    const Floats end = hn::IfThenElse(at_surface, surface_t, query_end);
    const Floats stop = hn::Max(t, hn::IfThenElse(crossed, hit, end));
    const Floats travelled = hn::IfThenElseZero(inside, stop - t);
    Mask at_limit = hn::AndNot(at_surface, missed & inside);
    if (rays_.bounded) {
      at_limit &= (end < load(lines_.reach, v)) | (end >= kInfinity);
    }
    const Floats medium_length = hn::IfThenElse(at_limit, load(lines_.max_medium_length, v),
                                                load(lines_.medium_length, v) + travelled);
    store(where, medium_length, lines_.medium_length, v);
    store(crossed, stop, lines_.t, v);
    const Uints one = set(uint32_t{1});
    store(entries, one, lines_.entered, v);
    if constexpr (!AtBoundary::kStops) {  // else lines end before the crossing
      store(exits, hit, lines_.last_exit, v);
      store(entries, hit, lines_.last_entry, v);
      store(exits, hn::Zero(UintTag()), lines_.inside, v);
      store(entries, one, lines_.inside, v);
    }
    const Uints crossings = load(lines_.crossings, v) + one;
    store(crossed, crossings, lines_.crossings, v);

    Vectors end_point = lines_.origin.load(v) + lines_.direction.load(v) * end;
    if constexpr (AtBoundary::kStops) {
      end_point = if_then_else(crossed, line_crossings_.point.load(v), end_point);
    }
    const Mask lost =
        hn::AndNot(may_be_inside(obstacles_, end_point, load(lines_.word, v)), at_limit) |
        (crossed & hn::RebindMask(d, crossings > set(kMaxCrossings)));
    Uints how = set(uint32_t{Rays::kEscaped});
    how = hn::IfThenElse(for_uints(at_surface), set(uint32_t{Rays::kSurface}), how);
    how = hn::IfThenElse(for_uints(at_limit), set(uint32_t{Rays::kInMedium}), how);
    Mask ended = missed | lost;
    if constexpr (AtBoundary::kStops) {
      how = hn::IfThenElse(for_uints(crossed), set(uint32_t{Rays::kCrossing}), how);
      ended = where;
    }
    how = hn::IfThenElse(for_uints(lost), set(uint32_t{Rays::kLeaked}), how);
    if (!hn::AllFalse(d, ended)) {
      end_lines(ended, v, how, at_surface, end_point);
      busy_ &= ~bits_of(ended, v);
    }
  }

  // Finds the point and the normal where lines have crossed the boundary. The point is that of the
  // barycentric coordinates: it is as near to the boundary as it can be, however far the line has
  // come. The normal is that of the corners which are tested.
  void locate(Mask crossed, size_t v) {
    for (LineBits bits = bits_of(crossed, v); bits != 0; bits &= bits - 1) {
      const int line = std::countr_zero(bits);
      const uint32_t block = line_crossings_.hit[line] / TriangleBlock::kSize;
      const uint32_t lane = line_crossings_.hit[line] % TriangleBlock::kSize;
      const auto corner = [&](size_t k) {
        const auto& axes = grid_.blocks[block].corners[k];
        return Vec3d{double{axes[0][lane]}, double{axes[1][lane]}, double{axes[2][lane]}};
      };
      const Vec3d a = corner(0), b = corner(1), c = corner(2);
      const auto sides = static_cast<Vec3d>(line_crossings_.sides.at(line));
      const Vec3d in_cell =
          (a * sides.x + b * sides.y + c * sides.z) * (1 / (sides.x + sides.y + sides.z));
      const auto middle = static_cast<Vec3d>(grid_.occupied[line_crossings_.cell[line]].middle);
      const uint32_t triangle = grid_.numbers[block][lane];
      const auto normal = static_cast<Vec3f>(itn::normalize(itn::cross(b - a, c - a)));
      const auto part = [&](double side) {
        return static_cast<float>(side / (sides.x + sides.y + sides.z));
      };
      line_crossings_.triangle[line] = triangle;
      line_crossings_.point.set(line, static_cast<Vec3f>(middle + in_cell));
      line_crossings_.normal.set(line, normal);
      if (obstacles_.corner_normals.flat()) continue;
      line_crossings_.smooth_normal.set(
          line, obstacles_.corner_normals.at(triangle, part(sides.y), part(sides.z), normal));
    }
  }

  // Writes results. A point on a surface is put into the plane of its triangle, so that a level
  // floor stays level.
  void end_lines(Mask ended, size_t v, Uints how, Mask at_surface, Vectors end_point) {
    // Lines that have not ended write to the spare place behind the last slot.
    const Ints ray = hn::BitCast(IntTag(), hn::IfThenElse(for_uints(ended), load(lines_.ray, v),
                                                          set(static_cast<uint32_t>(kSlots))));
    const auto write = [&](Floats from, FloatColumn& column) {
      hn::ScatterIndex(from, FloatTag(), column.data(), ray);
    };
    write(load(lines_.medium_length, v), rays_.medium_length);
    const Uints entered = hn::ShiftLeft<Rays::kEnteredBit>(load(lines_.entered, v));
    hn::ScatterIndex(how | entered, UintTag(), rays_.outcome.data(), ray);
    if constexpr (AtBoundary::kStops) {
      Crossings& crossings = *at_boundary_;
      const auto write_vectors = [&](const PerLineVectors& from, VectorColumn& to) {
        const Vectors values = from.load(v);
        write(values.x, to.x);
        write(values.y, to.y);
        write(values.z, to.z);
      };
      write_vectors(line_crossings_.normal, crossings.normal);
      if (!obstacles_.corner_normals.flat()) {
        write_vectors(line_crossings_.smooth_normal, crossings.smooth_normal);
      }
      hn::ScatterIndex(load(line_crossings_.triangle, v), UintTag(), crossings.triangle.data(),
                       ray);
    }
    if (report_ == Report::kLengths) return;
    Uints what = load(lines_.inside, v);
    if (!hn::AllFalse(FloatTag(), at_surface)) {
      const Surfaces& surfaces = obstacles_.surfaces;
      const Uints triangle = hn::IfThenElseZero(for_uints(at_surface), load(lines_.surface, v));
      const Ints index = hn::BitCast(IntTag(), triangle);
      const Vectors normal = gather(surfaces.normals, index);
      const Floats off = dot(end_point - gather(surfaces.corners[0], index), normal);
      end_point = if_then_else(at_surface, end_point - normal * off, end_point);
      const Uints number = hn::ShiftLeft<Rays::kSurfaceBit>(triangle + set(uint32_t{1}));
      what |= hn::IfThenElseZero(for_uints(at_surface), number);
    }
    write(end_point.x, rays_.position.x);
    write(end_point.y, rays_.position.y);
    write(end_point.z, rays_.position.z);
    hn::ScatterIndex(what, UintTag(), rays_.interaction.data(), ray);
  }

  // More crossings than this on one line mean that rounding has trapped it.
  static constexpr uint32_t kMaxCrossings = 100000;

  const Obstacles& obstacles_;
  const Grid& grid_;
  Rays& rays_;
  const size_t count_;
  const Report report_;
  Crossings* const at_boundary_;  // null for those that pass
  UintColumn pending_;            // rays to be followed
  size_t pending_count_ = 0;
  size_t next_ = 0;        // of the pending rays
  LineBits busy_ = 0;      // lines that have a ray
  LineBits stepping_ = 0;  // lines whose query is under way

  Lines lines_;
  [[no_unique_address]] typename AtBoundary::LineCrossings line_crossings_;
  TriangleTest<AtBoundary> triangle_test_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
