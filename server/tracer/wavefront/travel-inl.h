// Follows many straight lines at a time through the medium, the surfaces and out of the scene: the
// rules are those of Geometry::travel (reference/geometry.h), line by line.
//
// A line is a sequence of queries: inside the medium for its next exit, outside for its next entry.
// A query steps from cell to cell of the grid. kLines of them step at a time, several vectors full,
// so that the processor has other work while one waits for memory. A line whose query has ended
// waits until most of them have, then all that wait take their turn: the crossing is booked, and
// the next query of the line or a new line begins. Triangles are tested for one line at a time, a
// block of sixteen at once, as neighbouring lines do not look at the same cells.
#if defined(ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_
#undef ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <cfloat>
#include <cstddef>
#include <limits>

#include "server/tracer/boundary.h"
#include "server/tracer/wavefront/boundary.h"
#include "server/tracer/wavefront/math-inl.h"
#include "server/tracer/wavefront/rays.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Lines that are followed at a time.
constexpr size_t kLines = 64;

// A set of lines, a bit each.
using LineBits = uint64_t;
constexpr LineBits kAllLines = ~LineBits{0} >> (64 - kLines);

// Of the lines of the vector that begins with line v.
HWY_INLINE Mask mask_of(LineBits bits, size_t v) {
  bits >>= v;
  const uint8_t bytes[8] = {static_cast<uint8_t>(bits), static_cast<uint8_t>(bits >> 8)};
  return hn::LoadMaskBits(FloatTag(), bytes);
}
HWY_INLINE LineBits bits_of(Mask mask, size_t v = 0) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(FloatTag(), mask, bytes);
  return (bytes[0] | static_cast<LineBits>(bytes[1]) << 8) << v;
}
// Whether any of the vector's lines is in the set.
HWY_INLINE bool any(LineBits bits, size_t v) {
  return (bits >> v & ((LineBits{1} << lanes()) - 1)) != 0;
}
HWY_INLINE Mask not_zero(Uints v) {
  return hn::RebindMask(FloatTag(), hn::Ne(v, hn::Zero(UintTag())));
}
HWY_INLINE hn::Mask<UintTag> for_uints(Mask mask) {
  return hn::RebindMask(UintTag(), mask);
}

// Rays::surface_of, Surfaces::kNone where there is none.
HWY_INLINE Uints surface_of(Uints place) {
  return hn::Sub(hn::ShiftRight<1>(place), set(uint32_t{1}));
}

HWY_INLINE Floats load(const FloatColumn& column, size_t i) {
  return hn::Load(FloatTag(), column.data() + i);
}
HWY_INLINE Uints load(const UintColumn& column, size_t i) {
  return hn::Load(UintTag(), column.data() + i);
}
HWY_INLINE Vectors load(const VectorColumn& column, size_t i) {
  return {load(column.x, i), load(column.y, i), load(column.z, i)};
}
HWY_INLINE void store(Floats v, FloatColumn& column, size_t i) {
  hn::Store(v, FloatTag(), column.data() + i);
}
HWY_INLINE void store(Uints v, UintColumn& column, size_t i) {
  hn::Store(v, UintTag(), column.data() + i);
}
HWY_INLINE void store(Vectors v, VectorColumn& column, size_t i) {
  store(v.x, column.x, i);
  store(v.y, column.y, i);
  store(v.z, column.z, i);
}

template <typename T>
struct alignas(64) PerLine : std::array<T, kLines> {};

HWY_INLINE Floats load(const PerLine<float>& values, size_t v) {
  return hn::Load(FloatTag(), values.data() + v);
}
HWY_INLINE Uints load(const PerLine<uint32_t>& values, size_t v) {
  return hn::Load(UintTag(), values.data() + v);
}
HWY_INLINE void store(Floats from, PerLine<float>& to, size_t v) {
  hn::Store(from, FloatTag(), to.data() + v);
}
HWY_INLINE void store(Uints from, PerLine<uint32_t>& to, size_t v) {
  hn::Store(from, UintTag(), to.data() + v);
}
HWY_INLINE void store(Mask where, Floats from, PerLine<float>& to, size_t v) {
  store(hn::IfThenElse(where, from, load(to, v)), to, v);
}
HWY_INLINE void store(Mask where, Uints from, PerLine<uint32_t>& to, size_t v) {
  store(hn::IfThenElse(for_uints(where), from, load(to, v)), to, v);
}

struct PerLineVectors {
  PerLine<float> x, y, z;
  Vectors load(size_t v) const {
    return {HWY_NAMESPACE::load(x, v), HWY_NAMESPACE::load(y, v), HWY_NAMESPACE::load(z, v)};
  }
  void store(Mask where, Vectors from, size_t v) {
    HWY_NAMESPACE::store(where, from.x, x, v);
    HWY_NAMESPACE::store(where, from.y, y, v);
    HWY_NAMESPACE::store(where, from.z, z, v);
  }
  Vec3f at(size_t line) const { return {x[line], y[line], z[line]}; }
  void set(size_t line, Vec3f v) {
    x[line] = v.x;
    y[line] = v.y;
    z[line] = v.z;
  }
};

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Parts of blocks whose triangles are tested before their hits are measured.
constexpr size_t kPassed = 32;

// What becomes of lines at the boundary of the medium, known when the code is compiled: nothing, as
// it is index-matched, and the lines ask nobody.
struct IndexMatched {
  static constexpr bool kAsks = false;
  explicit IndexMatched(const BoundaryModel* /*none*/ = nullptr) {}
  struct Lines {};
};

// A model is asked at every crossing.
struct Modelled {
  static constexpr bool kAsks = true;
  explicit Modelled(const BoundaryModel* asked) : model(*asked) {}

  const BoundaryModel& model;
  Crossings crossings;  // of the rays

  // What lines under way know in addition.
  struct Lines {
    PerLine<float> transmittance{};
    // Of the nearest hit: the triangle, as its block * kSize + place in it; the number of the cell;
    // and the barycentric coordinates times a common factor.
    PerLine<uint32_t> hit{}, cell{};
    PerLineVectors sides{};
    // Of the crossing that a line ends in.
    PerLine<uint32_t> triangle{};
    PerLineVectors point{}, normal{};
    std::array<uint32_t, kPassed> first{};  // triangle of Traveller::Passed
  };
};

// The lines under way, and what their queries know. Distances are along the line, in mm, from an
// origin that lies a little behind its start.
template <typename AtBoundary>
class Traveller {
 public:
  // Without `places`, where lines end is not said.
  Traveller(const Boundary& boundary, Rays& rays, size_t count, bool places,
            AtBoundary& at_boundary)
      : boundary_(boundary),
        grid_(boundary.grid),
        rays_(rays),
        count_(count),
        places_(places),
        at_boundary_(at_boundary) {}

  void run() {
    glance();
    for (;;) {
      const LineBits waiting = busy_ & ~stepping_;
      for (size_t v = 0; v < kLines; v += lanes()) {
        if (any(waiting, v)) {
          conclude(mask_of(waiting, v), v);
        }
      }
      const LineBits fresh = take_rays();
      if (busy_ == 0) {
        return;
      }
      const LineBits turning = fresh | (waiting & busy_);
      for (size_t v = 0; v < kLines; v += lanes()) {
        if (any(fresh, v)) {
          begin_lines(mask_of(fresh, v), v);
        }
        if (any(turning, v)) {
          begin_queries(mask_of(turning, v), v);
        }
      }
      const int enough = next_ < pending_count_ ? kLines / 4 : 0;
      while (std::popcount(stepping_) > enough) {
        step();
      }
    }
  }

 private:
  // Most flights in a thick medium, and many connections, end where they have begun: in the same
  // empty cube, or in an occupied cell without coming near its triangles. These are found out in
  // the order of the rays, a vector at a time, and are done; the others are left to be followed.
  void glance() {
    const FloatTag d;
    for (size_t i = 0; i < count_; i += lanes()) {
      const Mask live = hn::FirstN(d, count_ - i);
      const Mask inside = not_zero(hn::And(load(rays_.place, i), set(Rays::kInside)));
      Mask done = hn::And(live, inside);
      if constexpr (AtBoundary::kAsks) {
        store(set(1.0F), at_boundary_.crossings.transmittance, i);
      }
      if (!hn::AllFalse(d, done)) {
        done = end_at_a_glance(i, done);
      }
      const Uints number = hn::Add(hn::Iota(UintTag(), 0), set(static_cast<uint32_t>(i)));
      hn::CompressStore(number, for_uints(hn::AndNot(done, live)), UintTag(),
                        pending_.data() + pending_count_);
      pending_count_ += hn::CountTrue(d, hn::AndNot(done, live));
    }
  }

  // Of the rays i, i + 1 ... that are asked for and start inside: those that are spent without
  // leaving their first cell or cube.
  Mask end_at_a_glance(size_t i, Mask asked) {
    const FloatTag d;
    const Vectors position = load(rays_.position, i), direction = load(rays_.direction, i);
    const Floats budget = load(rays_.budget, i);
    const auto [slack, start, origin] = start_of(position, direction);
    const Floats end = hn::Add(start, budget);
    const Vectors place = origin + direction * end;

    const Vectors x0 = in_cells(origin), dx = direction * set(grid_.inverse_edge);
    const Vectors cell{cell_at(x0.x, dx.x, slack, grid_.size[0]),
                       cell_at(x0.y, dx.y, slack, grid_.size[1]),
                       cell_at(x0.z, dx.z, slack, grid_.size[2])};
    const auto [word, reach] = read_cell(cell, octant_of(direction));
    // The end lies in the cube ahead.
    const auto within = [&](Floats c, Floats from, Floats slope) {
      const Floats to = hn::Sub(plus_product(from, slope, end), c);
      const Mask falls = hn::Lt(slope, hn::Zero(d));
      const Floats ahead = hn::IfThenElse(falls, hn::Sub(set(1.0F), to), to);
      return hn::And(hn::Ge(ahead, hn::Zero(d)), hn::Le(ahead, reach));
    };
    Mask done =
        hn::And(asked, hn::And(within(cell.x, x0.x, dx.x),
                               hn::And(within(cell.y, x0.y, dx.y), within(cell.z, x0.z, dx.z))));
    const Mask occupied = hn::And(done, not_zero(hn::And(word, set(Grid::kOccupied))));
    if (!hn::AllFalse(d, occupied)) {
      const Passage passage{origin, direction, set(1.0F), slack, end};
      done = hn::AndNot(may_cross(word, occupied, cell, passage), done);
    }
    done = hn::And(done, may_be_inside(place, word));
    if (!boundary_.surfaces.empty()) {
      done = hn::AndNot(reaches_surfaces(position, direction, budget, slack), done);
    }
    if (hn::AllFalse(d, done)) {
      return done;
    }
    store(hn::IfThenElse(done, budget, load(rays_.in_medium, i)), rays_.in_medium, i);
    const Uints outcome = set(Rays::kSpent | Rays::kEntered), inside = set(Rays::kInside);
    store(hn::IfThenElse(for_uints(done), outcome, load(rays_.outcome, i)), rays_.outcome, i);
    if (places_) {
      store(if_then_else(done, place, position), rays_.position, i);
      store(hn::IfThenElse(for_uints(done), inside, load(rays_.place, i)), rays_.place, i);
    }
    return done;
  }

  // Gives the next rays to lines that are free; returns the lines that got one.
  LineBits take_rays() {
    LineBits taken = 0;
    for (LineBits free = kAllLines & ~busy_; free != 0 && next_ < pending_count_;
         free &= free - 1) {
      const int line = std::countr_zero(free);
      ray_[line] = pending_[next_++];
      taken |= LineBits{1} << line;
    }
    busy_ |= taken;
    return taken;
  }

  // Lines start a little behind their origin (rule 3).
  struct Start {
    Floats slack, distance;
    Vectors origin;
  };
  Start start_of(Vectors position, Vectors direction) const {
    const Floats reach =
        hn::Max(hn::Abs(position.x), hn::Max(hn::Abs(position.y), hn::Abs(position.z)));
    const Floats slack = hn::Mul(set(4 * FLT_EPSILON), hn::Max(set(boundary_.extent), reach));
    const Floats distance = hn::Add(slack, slack);
    return {slack, distance, position - direction * distance};
  }

  // In the grid's coordinates.
  Vectors in_cells(Vectors x) const { return (x - set(grid_.low)) * set(grid_.inverse_edge); }

  // Number along an axis of the cell at a distance.
  Floats cell_at(Floats from, Floats slope, Floats distance, int size) const {
    return hn::Clamp(hn::Floor(plus_product(from, slope, distance)), hn::Zero(FloatTag()),
                     set(static_cast<float>(size - 1)));
  }

  static Uints octant_of(Vectors direction) {
    const auto falls = [&](Floats component, uint32_t bit) {
      return hn::IfThenElseZero(for_uints(hn::Lt(component, hn::Zero(FloatTag()))), set(bit));
    };
    return hn::Or(falls(direction.x, 1), hn::Or(falls(direction.y, 2), falls(direction.z, 4)));
  }

  void begin_lines(Mask fresh, size_t v) {
    const Ints ray = hn::BitCast(IntTag(), load(ray_, v));
    const auto gather = [&](const FloatColumn& column) {
      return hn::GatherIndex(FloatTag(), column.data(), ray);
    };
    const auto gather_vectors = [&](const VectorColumn& column) {
      return Vectors{gather(column.x), gather(column.y), gather(column.z)};
    };
    const Vectors position = gather_vectors(rays_.position);
    const Vectors direction = gather_vectors(rays_.direction);
    const auto [slack, start, origin] = start_of(position, direction);
    origin_.store(fresh, origin, v);
    direction_.store(fresh, direction, v);
    store(fresh, slack, slack_, v);
    store(fresh, start, t_, v);
    const Floats zero = hn::Zero(FloatTag());
    store(fresh, zero, in_medium_, v);
    store(fresh, zero, last_exit_, v);
    store(fresh, zero, last_entry_, v);
    if constexpr (AtBoundary::kAsks) {
      store(fresh, set(1.0F), lines_.transmittance, v);
    }
    const Floats budget = gather(rays_.budget);
    store(fresh, budget, budget_, v);
    const Uints place = hn::GatherIndex(UintTag(), rays_.place.data(), ray);
    const Uints inside = hn::And(place, set(Rays::kInside));
    store(fresh, inside, inside_, v);
    store(fresh, inside, entered_, v);
    store(fresh, hn::Zero(UintTag()), crossings_, v);

    // The same in the grid's coordinates, in cells. A component of 0 is taken as so small that the
    // faces it would cross are never met first.
    const Floats edge = set(grid_.edge), tiny = set(1e-20F);
    cells_origin_.store(fresh, in_cells(origin), v);
    cells_direction_.store(fresh, direction * set(grid_.inverse_edge), v);
    const auto mm_per_cell = [&](Floats component) {
      const Floats safe = hn::IfThenElse(hn::Lt(hn::Abs(component), tiny),
                                         hn::CopySign(tiny, component), component);
      return hn::Div(edge, safe);
    };
    mm_per_cell_.store(
        fresh, {mm_per_cell(direction.x), mm_per_cell(direction.y), mm_per_cell(direction.z)}, v);

    store(fresh, octant_of(direction), octant_, v);
    const Floats x = hn::Abs(direction.x), y = hn::Abs(direction.y), z = hn::Abs(direction.z);
    const Uints zero_or_one = hn::IfThenElseZero(for_uints(hn::Gt(y, x)), set(uint32_t{1}));
    store(fresh, hn::IfThenElse(for_uints(hn::Gt(z, hn::Max(x, y))), set(uint32_t{2}), zero_or_one),
          steepest_, v);

    store(fresh, set(kInfinity), surface_t_, v);
    store(fresh, set(Surfaces::kNone), surface_, v);
    if (!boundary_.surfaces.empty()) {
      begin_surfaces(fresh, v, position, direction, budget, place);
    }
  }

  // Whether lines of this length may meet the box of the surfaces.
  Mask reaches_surfaces(Vectors position, Vectors direction, Floats length, Floats slack) const {
    const Bounds& box = boundary_.surfaces.bounds;
    const auto overlaps = [&](Floats p, Floats q, float low, float high) {
      return hn::And(hn::Ge(hn::Add(hn::Max(p, q), slack), set(low)),
                     hn::Le(hn::Sub(hn::Min(p, q), slack), set(high)));
    };
    const Vectors to = position + direction * hn::Min(length, set(kFar));
    return hn::And(overlaps(position.x, to.x, box.min.x, box.max.x),
                   hn::And(overlaps(position.y, to.y, box.min.y, box.max.y),
                           overlaps(position.z, to.z, box.min.z, box.max.z)));
  }

  // Surfaces are looked for once for every line whose direction leads to their box: as soon as it
  // is outside, or may reach the box inside.
  void begin_surfaces(Mask fresh, size_t v, Vectors position, Vectors direction, Floats budget,
                      Uints place) {
    const Mask inside = not_zero(hn::And(place, set(Rays::kInside)));
    store(fresh, surface_of(place), excluded_, v);
    const Floats slack = load(slack_, v);

    const Mask ever = reaches_surfaces(position, direction, set(kFar), slack);
    const Mask soon = hn::Or(reaches_surfaces(position, direction, budget, slack), hn::Not(inside));
    store(fresh, hn::IfThenElseZero(for_uints(ever), set(uint32_t{1})), surface_unknown_, v);
    find_surfaces(hn::And(fresh, soon), v);
  }

  // The first surface on lines that have not looked for it yet.
  void find_surfaces(Mask where, size_t v) {
    where = hn::And(where, not_zero(load(surface_unknown_, v)));
    const FloatTag d;
    if (hn::AllFalse(d, where)) {
      return;
    }
    store(where, hn::Zero(UintTag()), surface_unknown_, v);
    const Surfaces& surfaces = boundary_.surfaces;
    if (surfaces.many) {
      find_many_surfaces(bits_of(where, v));
      return;
    }
    const Vectors o = origin_.load(v), w = direction_.load(v);
    const Floats from = load(slack_, v), zero = hn::Zero(d);
    const Uints excluded = load(excluded_, v);
    Floats nearest = load(surface_t_, v);
    Uints found = load(surface_, v);
    for (size_t i = 0; i < surfaces.triangles; ++i) {
      const Vectors n = set(surfaces.normals.at(i));
      const Floats cosine = dot(n, w);
      const Floats sign = hn::CopySign(set(1.0F), cosine);
      const Vectors a = set(surfaces.corners[0].at(i)) - o, b = set(surfaces.corners[1].at(i)) - o,
                    c = set(surfaces.corners[2].at(i)) - o;
      const Floats least =
          hn::Min(hn::Mul(sign, dot(w, cross(b, c))),
                  hn::Min(hn::Mul(sign, dot(w, cross(c, a))), hn::Mul(sign, dot(w, cross(a, b)))));
      const Floats t = hn::Div(dot(n, a), cosine);
      const auto number = set(static_cast<uint32_t>(i));
      Mask hits = hn::And(hn::Ge(least, zero), hn::Ne(cosine, zero));
      hits = hn::And(hits, hn::And(hn::Ge(t, from), hn::Lt(t, nearest)));
      hits = hn::And(hits, hn::RebindMask(d, hn::Ne(excluded, number)));
      nearest = hn::IfThenElse(hits, t, nearest);
      found = hn::IfThenElse(for_uints(hits), number, found);
    }
    store(where, nearest, surface_t_, v);
    store(where, found, surface_, v);
  }

  void find_many_surfaces(LineBits where) {
    const Surfaces& surfaces = boundary_.surfaces;
    const auto& first = surfaces.first_triangle_of_mesh;
    for (; where != 0; where &= where - 1) {
      const int i = std::countr_zero(where);
      Line line(origin_.at(i), direction_.at(i), {}, 0);
      if (excluded_[i] != Surfaces::kNone) {
        const auto mesh = std::upper_bound(first.begin(), first.end(), excluded_[i]) - 1;
        line.excluded = {static_cast<uint32_t>(mesh - first.begin()), excluded_[i] - *mesh};
      }
      line.origin = origin_.at(i);
      const Hit hit = surfaces.many->closest(line, slack_[i], kInfinity, Wanted::kSurfaceOnly);
      if (hit.found) {
        surface_t_[i] = hit.t;
        surface_[i] = first[hit.surface.surface] + hit.surface.triangle;
      }
    }
  }

  // The next query of lines: inside for an exit within the rest of the budget, outside for an
  // entry, both up to the surface.
  void begin_queries(Mask where, size_t v) {
    const FloatTag d;
    const Mask inside = not_zero(load(inside_, v));
    if (!boundary_.surfaces.empty()) {
      find_surfaces(hn::AndNot(inside, where), v);
    }
    const Floats t = load(t_, v);
    const Floats last = hn::IfThenElse(inside, load(last_exit_, v), load(last_entry_, v));
    // The next larger float: these are not negative.
    const Floats beyond = hn::BitCast(d, hn::Add(hn::BitCast(UintTag(), last), set(uint32_t{1})));
    const Floats t_min = hn::Max(hn::Sub(t, load(slack_, v)), beyond);
    const Floats rest = hn::Add(t, hn::Sub(load(budget_, v), load(in_medium_, v)));
    const Floats end = hn::Min(load(surface_t_, v), hn::IfThenElse(inside, rest, set(kInfinity)));
    store(where, t_min, t_min_, v);
    store(where, end, end_, v);
    store(where, set(kInfinity), hit_, v);
    store(where, hn::IfThenElse(inside, set(1.0F), set(-1.0F)), side_, v);
    // Counts as inside until a cell says otherwise.
    store(where, set(Grid::kInside), word_, v);

    // Clip to the grid.
    const Vectors x0 = cells_origin_.load(v), dx = cells_direction_.load(v);
    const Vectors mm = mm_per_cell_.load(v);
    Floats near = t_min, far = end;
    const auto clip = [&](Floats from, Floats scale, int size) {
      const Floats a = hn::Mul(hn::Neg(from), scale);
      const Floats b = hn::Mul(hn::Sub(set(static_cast<float>(size)), from), scale);
      near = hn::Max(near, hn::Min(a, b));
      far = hn::Min(far, hn::Max(a, b));
    };
    clip(x0.x, mm.x, grid_.size[0]);
    clip(x0.y, mm.y, grid_.size[1]);
    clip(x0.z, mm.z, grid_.size[2]);
    cell_.store(where,
                {cell_at(x0.x, dx.x, near, grid_.size[0]), cell_at(x0.y, dx.y, near, grid_.size[1]),
                 cell_at(x0.z, dx.z, near, grid_.size[2])},
                v);
    store(where, near, entered_cell_, v);
    store(where, far, grid_end_, v);
    stepping_ |= bits_of(hn::And(where, hn::Le(near, far)), v);
  }

  // All lines under way look at the cell that they are in, and take a step.
  HWY_INLINE void step() {
    LineBits to_test = 0;
    for (size_t v = 0; v < kLines; v += lanes()) {
      if (any(stepping_, v)) {
        to_test |= look(v);
      }
    }
    test_cells(to_test);
    LineBits stepping = 0;
    for (size_t v = 0; v < kLines; v += lanes()) {
      if (any(stepping_, v)) {
        stepping |= advance(v);
      }
    }
    stepping_ = stepping;
  }

  // A cell's word, and the edge of the empty cube ahead of it.
  struct CellWords {
    Uints word;
    Floats reach;
  };
  HWY_INLINE CellWords read_cell(Vectors cell, Uints octant) const {
    const IntTag di;
    const Floats row = set(static_cast<float>(grid_.size[0]));
    const Floats layer = set(static_cast<float>(grid_.size[0]) * static_cast<float>(grid_.size[1]));
    const Ints index =
        hn::ConvertTo(di, plus_product(plus_product(cell.x, cell.y, row), cell.z, layer));
    const auto* const cells = reinterpret_cast<const int32_t*>(grid_.cells.data());
    const auto* const reaches = reinterpret_cast<const int32_t*>(grid_.reaches.data());
    const Ints byte = hn::Add(hn::ShiftLeft<3>(index), hn::BitCast(di, octant));
    const Ints reach = hn::And(hn::GatherOffset(di, reaches, byte), hn::Set(di, Grid::kMaxReach));
    return {hn::BitCast(UintTag(), hn::GatherIndex(di, cells, index)),
            hn::ConvertTo(FloatTag(), reach)};
  }

  // Reads the words of the cells; returns the lines that have triangles to test there.
  HWY_INLINE LineBits look(size_t v) {
    const Mask stepping = mask_of(stepping_, v);
    const Vectors cell = cell_.load(v);
    const auto [word, reach] = read_cell(cell, load(octant_, v));
    store(stepping, word, word_, v);
    store(reach, reach_, v);
    const Mask occupied = hn::And(stepping, not_zero(hn::And(word, set(Grid::kOccupied))));
    if (hn::AllFalse(FloatTag(), occupied)) {
      return 0;
    }
    // Where the lines leave the cell, or end.
    const Vectors x0 = cells_origin_.load(v), dx = cells_direction_.load(v);
    const Vectors mm = mm_per_cell_.load(v);
    const auto leave = [&](Floats c, Floats from, Floats rate, Floats scale) {
      const Floats face = hn::IfThenElseZero(hn::Ge(rate, hn::Zero(FloatTag())), set(1.0F));
      return hn::Mul(hn::Add(hn::Sub(c, from), face), scale);
    };
    const Floats out =
        hn::Min(hn::Min(leave(cell.x, x0.x, dx.x, mm.x), load(grid_end_, v)),
                hn::Min(leave(cell.y, x0.y, dx.y, mm.y), leave(cell.z, x0.z, dx.z, mm.z)));
    const Passage passage{origin_.load(v), direction_.load(v), load(side_, v),
                          load(entered_cell_, v), out};
    return bits_of(may_cross(word, occupied, cell, passage), v);
  }

  // A step leaves the cube of empty cells ahead (an occupied cell alone) through the face that the
  // line meets first. The index along that axis is set from the cube, so every step makes progress
  // however the distance is rounded; the others follow from the position. Returns the lines whose
  // query goes on.
  HWY_INLINE LineBits advance(size_t v) {
    const FloatTag d;
    const Vectors x0 = cells_origin_.load(v), dx = cells_direction_.load(v);
    const Vectors mm = mm_per_cell_.load(v), cell = cell_.load(v);
    const Floats one = set(1.0F), zero = hn::Zero(d), reach = load(reach_, v);
    // Cells from here to the face that the line leaves through.
    const auto to_face = [&](Floats slope) {
      return hn::IfThenElse(hn::Lt(slope, zero), hn::Sub(one, reach), reach);
    };
    const auto leave = [&](Floats c, Floats from, Floats slope, Floats scale) {
      return hn::Mul(hn::Add(hn::Sub(c, from), to_face(slope)), scale);
    };
    const Floats leave_x = leave(cell.x, x0.x, dx.x, mm.x);
    const Floats leave_y = leave(cell.y, x0.y, dx.y, mm.y);
    const Floats leave_z = leave(cell.z, x0.z, dx.z, mm.z);
    const Floats t = hn::Min(leave_x, hn::Min(leave_y, leave_z));
    const Mask ended = hn::Ge(t, hn::Min(load(hit_, v), load(grid_end_, v)));

    const Mask along_x = hn::Eq(t, leave_x);
    const Mask along_y = hn::AndNot(along_x, hn::Eq(t, leave_y));
    const Mask along_z = hn::Not(hn::Or(along_x, along_y));
    const Floats before = hn::Sub(reach, one);
    const auto move = [&](Mask along, Floats c, Floats from, Floats slope, int size) {
      // The cells of the cube ahead, within the grid.
      const Floats far = hn::Clamp(hn::Add(c, hn::CopySign(before, slope)), zero,
                                   set(static_cast<float>(size - 1)));
      const Floats low = hn::Min(c, far), high = hn::Max(c, far);
      const Floats follow = hn::Clamp(hn::Floor(plus_product(from, slope, t)), low, high);
      return hn::IfThenElse(along, hn::Add(c, hn::CopySign(reach, slope)), follow);
    };
    const Vectors next{move(along_x, cell.x, x0.x, dx.x, grid_.size[0]),
                       move(along_y, cell.y, x0.y, dx.y, grid_.size[1]),
                       move(along_z, cell.z, x0.z, dx.z, grid_.size[2])};
    const auto within = [&](Floats c, int size) {
      return hn::And(hn::Ge(c, zero), hn::Lt(c, set(static_cast<float>(size))));
    };
    const Mask in_grid =
        hn::And(within(next.x, grid_.size[0]),
                hn::And(within(next.y, grid_.size[1]), within(next.z, grid_.size[2])));
    const Mask goes_on = hn::And(mask_of(stepping_, v), hn::AndNot(ended, in_grid));
    cell_.store(goes_on, next, v);
    store(t, entered_cell_, v);
    return bits_of(goes_on, v);
  }

  // Lines between two distances, where they pass through a cell; for crossings of which side
  // (side_).
  struct Passage {
    Vectors origin, direction;
    Floats side, from, to;
  };

  // Which of the lines in occupied cells may cross a triangle there in the direction that they look
  // for: not where the cone of the normals shows that all face the other way, nor where the line
  // passes the cell on one side of the slab that they lie in.
  HWY_INLINE Mask may_cross(Uints words, Mask where, Vectors cell, const Passage& line) const {
    const FloatTag d;
    const IntTag di;
    constexpr int kStride = sizeof(OccupiedCell) / sizeof(int32_t);
    constexpr size_t kNormals = offsetof(OccupiedCell, normals) / sizeof(int32_t);
    constexpr size_t kSlab = offsetof(OccupiedCell, slab) / sizeof(int32_t);
    const auto* const occupied = reinterpret_cast<const int32_t*>(grid_.occupied.data());
    const Ints number =
        hn::BitCast(di, hn::IfThenElseZero(for_uints(where), hn::And(words, set(Grid::kPayload))));
    const Ints at = hn::Mul(number, hn::Set(di, kStride));
    const Ints cone = hn::GatherIndex(di, occupied + kNormals, at);
    const auto component = [&](Ints shifted) {
      return hn::ConvertTo(d, hn::ShiftRight<24>(shifted));
    };
    const Vectors axis{component(hn::ShiftLeft<24>(cone)), component(hn::ShiftLeft<16>(cone)),
                       component(hn::ShiftLeft<8>(cone))};
    const auto upper = [&](Ints bits, auto shift) {
      return hn::ConvertTo(d, hn::BitCast(di, shift(hn::BitCast(UintTag(), bits))));
    };
    const Floats threshold = upper(cone, [](Uints bits) { return hn::ShiftRight<24>(bits); });
    const Floats slope = dot(line.direction, axis);
    const Mask faces = hn::And(where, hn::Lt(hn::Neg(hn::Mul(slope, line.side)), threshold));

    // a . (x - middle) at both ends.
    const Floats half = set(0.5F), edge = set(grid_.edge);
    const Vectors middle{plus_product(set(grid_.low.x), hn::Add(cell.x, half), edge),
                         plus_product(set(grid_.low.y), hn::Add(cell.y, half), edge),
                         plus_product(set(grid_.low.z), hn::Add(cell.z, half), edge)};
    const Floats at_origin = dot(line.origin - middle, axis);
    const Floats first = plus_product(at_origin, slope, line.from);
    const Floats last = plus_product(at_origin, slope, line.to);
    const Ints slab = hn::GatherIndex(di, occupied + kSlab, at);
    const Floats scale = set(grid_.slab_scale), per_unit = set(2.0F / 65535 * grid_.slab_scale);
    const Floats high = hn::Sub(
        hn::Mul(upper(slab, [](Uints bits) { return hn::ShiftRight<16>(bits); }), per_unit), scale);
    const Floats low = hn::Sub(
        hn::Mul(upper(slab, [](Uints bits) { return hn::And(bits, set(uint32_t{0xFFFF})); }),
                per_unit),
        scale);
    const Mask reaches =
        hn::And(hn::Ge(hn::Max(first, last), low), hn::Le(hn::Min(first, last), high));
    return hn::And(faces, reaches);
  }

  // Tests the triangles of the cells that lines have reached, for the nearest crossing between
  // t_min_ and the end of the query or an earlier hit. First all are tested without a branch, as
  // the processor would guess it wrong half of the time; then the distances of those that are hit
  // are computed.
  HWY_INLINE void test_cells(LineBits which) {
    const FloatTag tag;
    size_t passed = 0;
    for (; which != 0; which &= which - 1) {
      const int line = std::countr_zero(which);
      const OccupiedCell& cell = grid_.occupied[word_[line] & Grid::kPayload];
      const Shear shear = shear_along(line, cell.middle);
      for (uint32_t b = cell.first_block; b < cell.first_block + cell.block_count; ++b) {
        const TriangleBlock& block = grid_.blocks[b];
        for (size_t i = 0; i < TriangleBlock::kSize; i += lanes()) {
          const auto [u, v, w] = sides(block, i, shear);
          const Floats zero = hn::Zero(tag);
          const Mask within = hn::And(hn::Ge(hn::Min(u, hn::Min(v, w)), zero),
                                      hn::Gt(hn::Max(u, hn::Max(v, w)), zero));
          Passed& entry = passed_[passed];
          entry.line = line;
          entry.hits = bits_of(within);
          hn::Store(u, tag, entry.sides[0].data());
          hn::Store(v, tag, entry.sides[1].data());
          hn::Store(w, tag, entry.sides[2].data());
          for (size_t k = 0; k < 3; ++k) {
            entry.depths[k] = block.corners[k][shear.z].data() + i;
          }
          entry.c_z = shear.c_z;
          entry.per_z = shear.per_z;
          entry.to_c = shear.to_c;
          if constexpr (AtBoundary::kAsks) {
            lines_.first[passed] = b * TriangleBlock::kSize + static_cast<uint32_t>(i);
          }
          passed += entry.hits != 0 ? 1 : 0;
          if (passed == kPassed) {
            measure_hits(passed);
            passed = 0;
          }
        }
      }
    }
    measure_hits(passed);
  }

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
  HWY_INLINE Shear shear_along(int line, Vec3f middle) const {
    const Vec3f o = origin_.at(line) - middle, d = direction_.at(line);
    const float to_c = -itn::dot(o, d);
    const Vec3f c = o + d * to_c;
    const float slopes[] = {d.x, d.y, d.z}, from[] = {c.x, c.y, c.z};
    const uint32_t z = steepest_[line];
    const bool swap = (slopes[z] < 0) != (side_[line] < 0);
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
  static HWY_INLINE Sides sides(const TriangleBlock& block, size_t i, const Shear& shear) {
    struct Point {
      Floats x, y;
    };
    const auto corner = [&](size_t k) {
      const auto along = [&](uint32_t axis) {
        return hn::Load(FloatTag(), block.corners[k][axis].data() + i);
      };
      const Floats z = along(shear.z);
      return Point{hn::Sub(plus_product(along(shear.x), set(-shear.by_x), z), set(shear.c_x)),
                   hn::Sub(plus_product(along(shear.y), set(-shear.by_y), z), set(shear.c_y))};
    };
    const auto side = [](Point from, Point to) {
      return hn::Sub(hn::Mul(from.x, to.y), hn::Mul(from.y, to.x));
    };
    const Point p = corner(0), q = corner(1), r = corner(2);
    return {side(q, r), side(r, p), side(p, q)};
  }

  // The three sides of a triangle that is hit are the barycentric coordinates of the crossing,
  // times a common factor.
  HWY_INLINE void measure_hits(size_t count) {
    for (const Passed* entry = passed_; entry < passed_ + count; ++entry) {
      const int line = entry->line;
      for (LineBits bits = entry->hits; bits != 0; bits &= bits - 1) {
        const int i = std::countr_zero(bits);
        const float u = entry->sides[0][i], v = entry->sides[1][i], w = entry->sides[2][i];
        const float z =
            (u * entry->depths[0][i] + v * entry->depths[1][i] + w * entry->depths[2][i]) /
            (u + v + w);
        const float t = entry->to_c + (z - entry->c_z) * entry->per_z;
        const float end = std::min(end_[line], hit_[line]);
        if constexpr (AtBoundary::kAsks) {
          const uint32_t triangle = lines_.first[static_cast<size_t>(entry - passed_)];
          if (t >= t_min_[line] && t <= end) {
            lines_.hit[line] = triangle + static_cast<uint32_t>(i);
            lines_.cell[line] = word_[line] & Grid::kPayload;
            lines_.sides.set(line, {u, v, w});
          }
        }
        hit_[line] = t >= t_min_[line] && t <= end ? t : hit_[line];
      }
    }
  }

  // Books what queries have found: goes on to the next query of the line, or ends it.
  void conclude(Mask where, size_t v) {
    const FloatTag d;
    const Mask inside = not_zero(load(inside_, v));
    const Floats hit = load(hit_, v), surface_t = load(surface_t_, v), t = load(t_, v);
    const Mask crossed = hn::And(where, hn::Lt(hit, hn::Min(surface_t, set(kInfinity))));
    const Mask missed = hn::AndNot(crossed, where);

    Mask exits = hn::And(crossed, inside), entries = hn::AndNot(inside, crossed);
    const Floats end = load(end_, v);
    const Mask at_surface =
        hn::And(missed, hn::And(hn::Eq(end, surface_t), hn::Lt(surface_t, set(kInfinity))));
    const Floats stop = hn::Max(t, hn::IfThenElse(crossed, hit, end));
    // Lines that the boundary bends end there, before the crossing.
    [[maybe_unused]] Mask bent = crossed;
    if constexpr (AtBoundary::kAsks) {
      store(entries, set(uint32_t{1}), entered_, v);
      bent = ask(crossed, v);
      exits = hn::AndNot(bent, exits);
      entries = hn::AndNot(bent, entries);
    }
    const Floats travelled = hn::IfThenElseZero(inside, hn::Sub(stop, t));
    const Mask spent = hn::AndNot(at_surface, hn::And(missed, inside));
    const Floats in_medium =
        hn::IfThenElse(spent, load(budget_, v), hn::Add(load(in_medium_, v), travelled));
    store(where, in_medium, in_medium_, v);
    store(crossed, stop, t_, v);
    store(exits, hit, last_exit_, v);
    store(entries, hit, last_entry_, v);
    const Uints one = set(uint32_t{1});
    store(exits, hn::Zero(UintTag()), inside_, v);
    store(entries, one, inside_, v);
    store(entries, one, entered_, v);
    const Uints crossings = hn::Add(load(crossings_, v), one);
    store(crossed, crossings, crossings_, v);

    Vectors place = origin_.load(v) + direction_.load(v) * end;
    if constexpr (AtBoundary::kAsks) {
      place = if_then_else(bent, lines_.point.load(v), place);
    }
    const Mask lost =
        hn::Or(hn::AndNot(may_be_inside(place, load(word_, v)), spent),
               hn::And(crossed, hn::RebindMask(d, hn::Gt(crossings, set(kMaxCrossings)))));
    Uints how = set(uint32_t{Rays::kEscaped});
    how = hn::IfThenElse(for_uints(at_surface), set(uint32_t{Rays::kSurface}), how);
    how = hn::IfThenElse(for_uints(spent), set(uint32_t{Rays::kSpent}), how);
    Mask ended = hn::Or(missed, lost);
    if constexpr (AtBoundary::kAsks) {
      how = hn::IfThenElse(for_uints(bent), set(uint32_t{Rays::kCrossing}), how);
      ended = hn::Or(ended, bent);
    }
    how = hn::IfThenElse(for_uints(lost), set(uint32_t{Rays::kLeaked}), how);
    if (!hn::AllFalse(d, ended)) {
      end_lines(ended, v, how, at_surface, place);
      busy_ &= ~bits_of(ended, v);
    }
  }

  // Asks the model about crossings; returns the lines that it bends. The point is that of the
  // barycentric coordinates: it is as near to the boundary as it can be, however far the line has
  // come. The normal is that of the corners which are tested.
  Mask ask(Mask crossed, size_t v) {
    LineBits bent = 0;
    for (LineBits bits = bits_of(crossed, v); bits != 0; bits &= bits - 1) {
      const int line = std::countr_zero(bits);
      const uint32_t block = lines_.hit[line] / TriangleBlock::kSize;
      const uint32_t lane = lines_.hit[line] % TriangleBlock::kSize;
      const auto corner = [&](size_t k) {
        const auto& axes = grid_.blocks[block].corners[k];
        return Vec3d{double{axes[0][lane]}, double{axes[1][lane]}, double{axes[2][lane]}};
      };
      const Vec3d a = corner(0), b = corner(1), c = corner(2);
      const Vec3d normal = itn::cross(b - a, c - a);
      const auto sides = static_cast<Vec3d>(lines_.sides.at(line));
      const Vec3d in_cell =
          (a * sides.x + b * sides.y + c * sides.z) * (1 / (sides.x + sides.y + sides.z));
      const auto middle = static_cast<Vec3d>(grid_.occupied[lines_.cell[line]].middle);
      const BoundaryInteraction at{.point = static_cast<Vec3f>(middle + in_cell),
                                   .normal = static_cast<Vec3f>(itn::normalize(normal)),
                                   .direction = direction_.at(line),
                                   .triangle = grid_.numbers[block][lane],
                                   .leaving = inside_[line] != 0};
      if (at_boundary_.model.straight()) {
        lines_.transmittance[line] *= at_boundary_.model.transmittance(at);
      } else {
        lines_.triangle[line] = at.triangle;
        lines_.point.set(line, at.point);
        lines_.normal.set(line, at.normal);
        bent |= LineBits{1} << line;
      }
    }
    return mask_of(bent, v);
  }

  // Whether what the grid knows allows that points lie in the medium, given the cell's word.
  Mask may_be_inside(Vectors p, Uints word) const {
    const Mask allowed = not_zero(hn::And(word, set(Grid::kOccupied | Grid::kInside)));
    const float margin = 16 * FLT_EPSILON * boundary_.extent;
    const auto within = [&](Floats x, float low, float high) {
      return hn::And(hn::Ge(x, set(low - margin)), hn::Le(x, set(high + margin)));
    };
    const Bounds& box = boundary_.bounds;
    return hn::And(allowed, hn::And(within(p.x, box.min.x, box.max.x),
                                    hn::And(within(p.y, box.min.y, box.max.y),
                                            within(p.z, box.min.z, box.max.z))));
  }

  // Writes results. A point on a surface is put into the plane of its triangle, so that a level
  // floor stays level.
  void end_lines(Mask ended, size_t v, Uints how, Mask at_surface, Vectors place) {
    // Lines that have not ended write to the spare place behind the last slot.
    const Ints ray = hn::BitCast(IntTag(), hn::IfThenElse(for_uints(ended), load(ray_, v),
                                                          set(static_cast<uint32_t>(kSlots))));
    const auto write = [&](Floats from, FloatColumn& column) {
      hn::ScatterIndex(from, FloatTag(), column.data(), ray);
    };
    write(load(in_medium_, v), rays_.in_medium);
    const Uints entered = hn::ShiftLeft<Rays::kEnteredBit>(load(entered_, v));
    hn::ScatterIndex(hn::Or(how, entered), UintTag(), rays_.outcome.data(), ray);
    if constexpr (AtBoundary::kAsks) {
      Crossings& crossings = at_boundary_.crossings;
      write(load(lines_.transmittance, v), crossings.transmittance);
      const Vectors normal = lines_.normal.load(v);
      write(normal.x, crossings.normal.x);
      write(normal.y, crossings.normal.y);
      write(normal.z, crossings.normal.z);
      hn::ScatterIndex(load(lines_.triangle, v), UintTag(), crossings.triangle.data(), ray);
    }
    if (!places_) {
      return;
    }
    Uints what = load(inside_, v);
    if (!hn::AllFalse(FloatTag(), at_surface)) {
      const Surfaces& surfaces = boundary_.surfaces;
      const Uints triangle = hn::IfThenElseZero(for_uints(at_surface), load(surface_, v));
      const Ints index = hn::BitCast(IntTag(), triangle);
      const auto gather = [&](const Surfaces::Vectors& from) {
        return Vectors{hn::GatherIndex(FloatTag(), from.x.data(), index),
                       hn::GatherIndex(FloatTag(), from.y.data(), index),
                       hn::GatherIndex(FloatTag(), from.z.data(), index)};
      };
      const Vectors normal = gather(surfaces.normals);
      const Floats off = dot(place - gather(surfaces.corners[0]), normal);
      place = if_then_else(at_surface, place - normal * off, place);
      const Uints number = hn::ShiftLeft<1>(hn::Add(triangle, set(uint32_t{1})));
      what = hn::Or(what, hn::IfThenElseZero(for_uints(at_surface), number));
    }
    write(place.x, rays_.position.x);
    write(place.y, rays_.position.y);
    write(place.z, rays_.position.z);
    hn::ScatterIndex(what, UintTag(), rays_.place.data(), ray);
  }

  // As long as any line, but not infinite: it may be multiplied by 0.
  static constexpr float kFar = 1e30F;
  // More crossings than this on one line mean that rounding has trapped it.
  static constexpr uint32_t kMaxCrossings = 100000;

  const Boundary& boundary_;
  const Grid& grid_;
  Rays& rays_;
  const size_t count_;
  const bool places_;
  AtBoundary& at_boundary_;
  UintColumn pending_;  // rays to be followed
  size_t pending_count_ = 0;
  size_t next_ = 0;        // of the pending rays
  LineBits busy_ = 0;      // lines that have a ray
  LineBits stepping_ = 0;  // lines whose query is under way

  // By line; values of free lines are never used, but are loaded.
  PerLineVectors origin_{}, direction_{};
  PerLineVectors cells_origin_{};     // in cells from the grid's corner
  PerLineVectors cells_direction_{};  // in cells per mm
  PerLineVectors mm_per_cell_{};
  PerLineVectors cell_{};
  PerLine<float> slack_{}, t_{}, in_medium_{}, budget_{};
  PerLine<float> last_exit_{}, last_entry_{};
  PerLine<float> t_min_{}, end_{}, grid_end_{}, hit_{}, side_{};
  PerLine<float> surface_t_{}, reach_{}, entered_cell_{};
  PerLine<uint32_t> inside_{}, entered_{}, crossings_{}, word_{}, ray_{};
  PerLine<uint32_t> surface_{}, surface_unknown_{}, excluded_{}, octant_{};
  PerLine<uint32_t> steepest_{};  // axis that the line is nearest to

  // Parts of blocks with triangles that a line passes within.
  struct Passed {
    alignas(64) std::array<float, kMaxLanes> sides[3];
    LineBits hits;
    int line;
    std::array<const float*, 3> depths;  // of the corners, along the axis nearest to the line
    float c_z, per_z, to_c;              // t = to_c + (z - c_z) per_z
  };
  Passed passed_[kPassed];
  [[no_unique_address]] typename AtBoundary::Lines lines_;
};

// Follows the first `count` rays; without `places`, does not say where they end.
template <typename AtBoundary>
HWY_INLINE void travel(const Boundary& boundary, Rays& rays, size_t count, bool places,
                       AtBoundary& at_boundary) {
  Traveller<AtBoundary>(boundary, rays, count, places, at_boundary).run();
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
