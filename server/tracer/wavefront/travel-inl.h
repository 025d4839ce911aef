// Follows many straight lines at a time through the medium, the surfaces and out of the scene: the
// rules are those of Geometry::travel (reference/geometry.h), line by line.
//
// A line is a sequence of queries: inside the medium for its next exit, outside for its next entry.
// A query steps from cell to cell of the grid. Lines take steps in lanes; a lane whose query has
// ended waits until half of them have, then all that wait take their turn: the crossing is booked,
// and the next query of the line or a new line begins. Triangles are tested for one line at a time,
// a block of sixteen at once, as neighbouring lines do not look at the same cells.
#if defined(ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_
#undef ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_TRAVEL_INL_H_
#endif

#include <bit>
#include <cfloat>
#include <limits>

#include "server/tracer/wavefront/boundary.h"
#include "server/tracer/wavefront/math-inl.h"
#include "server/tracer/wavefront/rays.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// A set of lanes, a bit each.
using LaneBits = uint32_t;

HWY_INLINE Mask mask_of(LaneBits bits) {
  const uint8_t bytes[8] = {static_cast<uint8_t>(bits), static_cast<uint8_t>(bits >> 8)};
  return hn::LoadMaskBits(FloatTag(), bytes);
}
HWY_INLINE LaneBits bits_of(Mask mask) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(FloatTag(), mask, bytes);
  return bytes[0] | static_cast<LaneBits>(bytes[1]) << 8;
}
HWY_INLINE Mask not_zero(Uints v) {
  return hn::RebindMask(FloatTag(), hn::Ne(v, hn::Zero(UintTag())));
}
HWY_INLINE hn::Mask<UintTag> for_uints(Mask mask) {
  return hn::RebindMask(UintTag(), mask);
}

template <typename T>
using PerLane = T[kMaxLanes];

HWY_INLINE Floats load(const PerLane<float>& v) {
  return hn::Load(FloatTag(), v);
}
HWY_INLINE Uints load(const PerLane<uint32_t>& v) {
  return hn::Load(UintTag(), v);
}
HWY_INLINE void store(Floats v, PerLane<float>& to) {
  hn::Store(v, FloatTag(), to);
}
HWY_INLINE void store(Uints v, PerLane<uint32_t>& to) {
  hn::Store(v, UintTag(), to);
}
HWY_INLINE void store(Mask where, Floats v, PerLane<float>& to) {
  store(hn::IfThenElse(where, v, load(to)), to);
}
HWY_INLINE void store(Mask where, Uints v, PerLane<uint32_t>& to) {
  store(hn::IfThenElse(for_uints(where), v, load(to)), to);
}

struct PerLaneVectors {
  alignas(64) PerLane<float> x, y, z;
  Vectors load() const {
    return {HWY_NAMESPACE::load(x), HWY_NAMESPACE::load(y), HWY_NAMESPACE::load(z)};
  }
  void store(Mask where, Vectors v) {
    HWY_NAMESPACE::store(where, v.x, x);
    HWY_NAMESPACE::store(where, v.y, y);
    HWY_NAMESPACE::store(where, v.z, z);
  }
  Vec3f at(size_t lane) const { return {x[lane], y[lane], z[lane]}; }
};

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// The nearest crossing of a block's triangles at a distance in [t_min, t_max], or infinity. `side`
// is +1 to find exits, -1 to find entries.
//
// Seen from the origin, with corners A, B, C relative to it and n = (B - A) x (C - A), the line
// meets the triangle if
//   d . (B x C),  d . (C x A),  d . (A x B),
// whose sum is D = n . d, all have the sign of D; D > 0 where the line leaves. The distance is
// n . A / D. Each of the three belongs to an edge, and swapping the edge's ends negates it exactly:
// two triangles that share an edge agree on which side of it the line passes, and none slips
// between (the signs are those of the Pluecker coordinates of the line and the edges).
HWY_INLINE float nearest_in_block(const TriangleBlock& block, Vec3f origin, Vec3f direction,
                                  float side, float t_min, float t_max) {
  const FloatTag d;
  const Vectors o = set(origin), w = set(direction);
  const Floats sign = set(side), zero = hn::Zero(d);
  float nearest = kInfinity;
  for (size_t i = 0; i < TriangleBlock::kSize; i += lanes()) {
    const auto vectors = [&](const TriangleBlock::Lane(&lane)[3]) {
      return Vectors{hn::Load(d, lane[0].data() + i), hn::Load(d, lane[1].data() + i),
                     hn::Load(d, lane[2].data() + i)};
    };
    const Vectors n = vectors(block.normal);
    const Vectors a = vectors(block.corners[0]) - o, b = vectors(block.corners[1]) - o,
                  c = vectors(block.corners[2]) - o;
    const Floats size = hn::Mul(dot(n, w), sign);
    const Floats least =
        hn::Min(hn::Mul(sign, dot(w, cross(b, c))),
                hn::Min(hn::Mul(sign, dot(w, cross(c, a))), hn::Mul(sign, dot(w, cross(a, b)))));
    const Mask within = hn::And(hn::Gt(size, zero), hn::Ge(least, zero));
    if (HWY_LIKELY(hn::AllFalse(d, within))) {
      continue;
    }
    const Floats t = hn::Div(hn::Mul(sign, dot(n, a)), size);
    const Mask hits = hn::And(within, hn::And(hn::Ge(t, set(t_min)), hn::Le(t, set(t_max))));
    const Floats masked = hn::IfThenElse(hits, t, set(kInfinity));
    nearest = std::min(nearest, hn::GetLane(hn::MinOfLanes(d, masked)));
  }
  return nearest;
}

// The lines under way, and what their queries know. Distances are along the line, in mm, from an
// origin that lies a little behind its start.
class Traveller {
 public:
  Traveller(const Boundary& boundary, Rays& rays, size_t count)
      : boundary_(boundary), grid_(boundary.grid), rays_(rays), count_(count) {}

  void run() {
    const LaneBits all = (LaneBits{1} << lanes()) - 1;
    for (;;) {
      const LaneBits waiting = busy_ & ~stepping_;
      if (waiting != 0) {
        conclude(waiting);
      }
      LaneBits fresh = all & ~busy_;
      if (fresh != 0 && next_ray_ < count_) {
        fresh = take_rays(fresh);
        begin_lines(mask_of(fresh));
      } else {
        fresh = 0;
      }
      if (busy_ == 0) {
        return;
      }
      begin_queries(fresh | (waiting & busy_));
      const int enough = next_ray_ < count_ ? static_cast<int>(lanes()) / 2 : 0;
      while (std::popcount(stepping_) > enough) {
        step(enough);
      }
    }
  }

 private:
  // Gives the next rays to lanes that have none; returns the lanes that got one.
  LaneBits take_rays(LaneBits free) {
    LaneBits taken = 0;
    for (; free != 0 && next_ray_ < count_; free &= free - 1) {
      const int lane = std::countr_zero(free);
      ray_[lane] = static_cast<uint32_t>(next_ray_++);
      taken |= LaneBits{1} << lane;
    }
    busy_ |= taken;
    return taken;
  }

  // Lines start a little behind their origin (rule 3).
  void begin_lines(Mask fresh) {
    const Ints ray = hn::BitCast(IntTag(), load(ray_));
    const auto gather = [&](const FloatColumn& column) {
      return hn::GatherIndex(FloatTag(), column.data(), ray);
    };
    const auto gather_vectors = [&](const VectorColumn& column) {
      return Vectors{gather(column.x), gather(column.y), gather(column.z)};
    };
    const Vectors position = gather_vectors(rays_.position);
    const Vectors direction = gather_vectors(rays_.direction);
    const Floats reach = hn::Max(hn::Abs(position.x),
                                 hn::Max(hn::Abs(position.y), hn::Abs(position.z)));
    const Floats slack =
        hn::Mul(set(4 * FLT_EPSILON), hn::Max(set(boundary_.extent), reach));
    const Floats start = hn::Add(slack, slack);
    const Vectors origin = position - direction * start;
    origin_.store(fresh, origin);
    direction_.store(fresh, direction);
    store(fresh, slack, slack_);
    store(fresh, start, t_);
    const Floats zero = hn::Zero(FloatTag());
    store(fresh, zero, in_medium_);
    store(fresh, zero, last_exit_);
    store(fresh, zero, last_entry_);
    const Floats budget = gather(rays_.budget);
    store(fresh, budget, budget_);
    const Uints inside = hn::GatherIndex(UintTag(), rays_.inside.data(), ray);
    store(fresh, inside, inside_);
    store(fresh, inside, entered_);
    store(fresh, hn::Zero(UintTag()), crossings_);

    // The same in the grid's coordinates, in cells. A component of 0 is taken as so small that the
    // faces it would cross are never met first.
    const Floats per_edge = set(grid_.inverse_edge), edge = set(grid_.edge);
    const Floats tiny = set(1e-20F);
    const Vectors in_cells = (origin - set(grid_.low)) * per_edge;
    cells_origin_.store(fresh, in_cells);
    cells_direction_.store(fresh, direction * per_edge);
    const auto mm_per_cell = [&](Floats component) {
      const Floats safe = hn::IfThenElse(hn::Lt(hn::Abs(component), tiny),
                                         hn::CopySign(tiny, component), component);
      return hn::Div(edge, safe);
    };
    mm_per_cell_.store(fresh, {mm_per_cell(direction.x), mm_per_cell(direction.y),
                               mm_per_cell(direction.z)});

    begin_surfaces(fresh, position, direction, budget, inside, start);
  }

  // Surfaces are looked for once for every line, when it is outside or may reach their box.
  void begin_surfaces(Mask fresh, Vectors position, Vectors direction, Floats budget, Uints inside,
                      Floats start) {
    store(fresh, set(kInfinity), surface_t_);
    store(fresh, set(Surfaces::kNone), surface_);
    if (boundary_.surfaces.empty()) {
      store(fresh, set(uint32_t{1}), surface_known_);
      return;
    }
    const Ints ray = hn::BitCast(IntTag(), load(ray_));
    store(fresh, hn::GatherIndex(UintTag(), rays_.surface.data(), ray), excluded_);
    const Floats behind = hn::GatherIndex(FloatTag(), rays_.behind.data(), ray);
    const Floats from = hn::Sub(hn::Sub(start, load(slack_)), behind);
    store(fresh, from, surface_from_);

    const Vectors end = position + direction * budget;
    const Floats slack = load(slack_);
    const auto overlaps = [&](Floats p, Floats q, float low, float high) {
      return hn::And(hn::Ge(hn::Add(hn::Max(p, q), slack), set(low)),
                     hn::Le(hn::Sub(hn::Min(p, q), slack), set(high)));
    };
    const Bounds& box = boundary_.surfaces.bounds;
    const Mask near = hn::And(overlaps(position.x, end.x, box.min.x, box.max.x),
                              hn::And(overlaps(position.y, end.y, box.min.y, box.max.y),
                                      overlaps(position.z, end.z, box.min.z, box.max.z)));
    const Mask outside = hn::Not(not_zero(inside));
    const Mask known = hn::Not(hn::Or(near, outside));
    // Not known yet: the others look when they leave.
    store(fresh, hn::Zero(UintTag()), surface_known_);
    find_surfaces(hn::AndNot(known, fresh));
  }

  // The first surface on the lines.
  void find_surfaces(Mask where) {
    where = hn::AndNot(not_zero(load(surface_known_)), where);
    const FloatTag d;
    if (hn::AllFalse(d, where)) {
      return;
    }
    store(where, set(uint32_t{1}), surface_known_);
    const Surfaces& surfaces = boundary_.surfaces;
    if (surfaces.many) {
      find_many_surfaces(bits_of(where));
      return;
    }
    const Vectors o = origin_.load(), w = direction_.load();
    const Floats from = load(surface_from_), zero = hn::Zero(d);
    const Uints excluded = load(excluded_);
    Floats nearest = load(surface_t_);
    Uints found = load(surface_);
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
    store(where, nearest, surface_t_);
    store(where, found, surface_);
  }

  void find_many_surfaces(LaneBits where) {
    const Surfaces& surfaces = boundary_.surfaces;
    for (; where != 0; where &= where - 1) {
      const int lane = std::countr_zero(where);
      Line line(origin_.at(lane), direction_.at(lane), {}, 0);
      line.origin = origin_.at(lane);
      if (excluded_[lane] != Surfaces::kNone) {
        const auto& first = surfaces.first_triangle_of_mesh;
        const auto mesh = std::upper_bound(first.begin(), first.end(), excluded_[lane]) - 1;
        line.excluded = {static_cast<uint32_t>(mesh - first.begin()), excluded_[lane] - *mesh};
      }
      // Embree knows no negative distances: what lies behind is reached from there.
      const float shift = std::min(0.0F, surface_from_[lane]);
      line.origin = line.origin + line.direction * shift;
      const Hit hit = surfaces.many->closest(line, surface_from_[lane] - shift, kInfinity,
                                             Wanted::kSurfaceOnly);
      if (hit.found) {
        surface_t_[lane] = hit.t + shift;
        surface_[lane] =
            surfaces.first_triangle_of_mesh[hit.surface.surface] + hit.surface.triangle;
      }
    }
  }

  // The next query of lines: inside for an exit within the rest of the budget, outside for an
  // entry, both up to the surface.
  void begin_queries(LaneBits which) {
    const FloatTag d;
    const Mask where = mask_of(which);
    const Mask inside = not_zero(load(inside_));
    if (!boundary_.surfaces.empty()) {
      find_surfaces(hn::AndNot(inside, where));
    }
    const Floats t = load(t_);
    const Floats last = hn::IfThenElse(inside, load(last_exit_), load(last_entry_));
    // The next larger float: these are not negative.
    const Floats beyond = hn::BitCast(d, hn::Add(hn::BitCast(UintTag(), last), set(uint32_t{1})));
    const Floats t_min = hn::Max(hn::Sub(t, load(slack_)), beyond);
    const Floats rest = hn::Add(t, hn::Sub(load(budget_), load(in_medium_)));
    const Floats end =
        hn::Min(load(surface_t_), hn::IfThenElse(inside, rest, set(kInfinity)));
    store(where, t_min, t_min_);
    store(where, end, end_);
    store(where, set(kInfinity), hit_);
    store(where, hn::IfThenElse(inside, set(1.0F), set(-1.0F)), side_);
    // Counts as inside until a cell says otherwise.
    store(where, set(Grid::kInside), word_);

    // Clip to the grid.
    const Vectors x0 = cells_origin_.load(), dx = cells_direction_.load(), mm = mm_per_cell_.load();
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
    const auto cell = [&](Floats from, Floats slope, int size) {
      return hn::Clamp(hn::Floor(plus_product(from, slope, near)), hn::Zero(d),
                       set(static_cast<float>(size - 1)));
    };
    cell_.store(where, {cell(x0.x, dx.x, grid_.size[0]), cell(x0.y, dx.y, grid_.size[1]),
                        cell(x0.z, dx.z, grid_.size[2])});
    store(where, far, grid_end_);
    stepping_ = (stepping_ & ~which) | bits_of(hn::And(where, hn::Le(near, far)));
  }

  // Steps from cell to cell, until all lanes but `enough` have ended their queries. A step leaves
  // the cube of empty cells around the current one, whose half edge is the distance that the cell
  // holds (1 for an occupied cell: the cell itself), through the face that the line meets first.
  // The index along that axis is set from the cube, so every step makes progress however the
  // distance is rounded; the others follow from the position.
  HWY_INLINE void step(int enough) {
    const FloatTag d;
    const UintTag du;
    const Vectors x0 = cells_origin_.load(), dx = cells_direction_.load(), mm = mm_per_cell_.load();
    const Floats one = set(1.0F), zero = hn::Zero(d);
    const Vectors sign{hn::CopySign(one, dx.x), hn::CopySign(one, dx.y), hn::CopySign(one, dx.z)};
    // Of the faces of a cell, relative to it: that the line leaves through, for a reach of 0.
    const auto ahead = [&](Floats slope) { return hn::IfThenElseZero(hn::Lt(slope, zero), one); };
    const Vectors faces{hn::Sub(ahead(dx.x), x0.x), hn::Sub(ahead(dx.y), x0.y),
                        hn::Sub(ahead(dx.z), x0.z)};
    const Vectors top{set(static_cast<float>(grid_.size[0] - 1)),
                      set(static_cast<float>(grid_.size[1] - 1)),
                      set(static_cast<float>(grid_.size[2] - 1))};
    const Floats row = set(static_cast<float>(grid_.size[0]));
    const Floats layer = set(static_cast<float>(grid_.size[0]) * static_cast<float>(grid_.size[1]));
    const Floats grid_end = load(grid_end_);
    const auto* const cells = reinterpret_cast<const int32_t*>(grid_.cells.data());
    Vectors cell = cell_.load();
    Uints word = load(word_);
    Mask stepping = mask_of(stepping_);

    do {
      const Floats index = plus_product(plus_product(cell.x, cell.y, row), cell.z, layer);
      const Uints here = hn::BitCast(
          du, hn::GatherIndex(IntTag(), cells, hn::ConvertTo(IntTag(), index)));
      word = hn::IfThenElse(for_uints(stepping), here, word);
      const Mask occupied =
          hn::RebindMask(d, hn::Ne(hn::And(here, set(Grid::kOccupied)), hn::Zero(du)));
      const LaneBits to_test = bits_of(hn::And(occupied, stepping));
      if (to_test != 0) {
        alignas(64) PerLane<uint32_t> words;
        store(here, words);
        test_cells(to_test, words);
      }
      const Uints payload = hn::And(here, set(Grid::kPayload));
      const Floats distance = hn::ConvertTo(d, hn::BitCast(IntTag(), payload));
      const Floats reach = hn::IfThenElse(occupied, one, distance);
      const Vectors leave{
          hn::Mul(plus_product(hn::Add(cell.x, faces.x), sign.x, reach), mm.x),
          hn::Mul(plus_product(hn::Add(cell.y, faces.y), sign.y, reach), mm.y),
          hn::Mul(plus_product(hn::Add(cell.z, faces.z), sign.z, reach), mm.z)};
      const Floats t = hn::Min(leave.x, hn::Min(leave.y, leave.z));
      const Mask ended = hn::Ge(t, hn::Min(load(hit_), grid_end));

      const Mask along_x = hn::Eq(t, leave.x);
      const Mask along_y = hn::AndNot(along_x, hn::Eq(t, leave.y));
      const Mask along_z = hn::Not(hn::Or(along_x, along_y));
      const Floats before = hn::Sub(reach, one);
      const auto advance = [&](Mask along, Floats c, Floats from, Floats slope, Floats direction,
                               Floats last) {
        const Floats low = hn::Max(zero, hn::Sub(c, before));
        const Floats high = hn::Min(last, hn::Add(c, before));
        const Floats follow = hn::Clamp(hn::Floor(plus_product(from, slope, t)), low, high);
        return hn::IfThenElse(along, plus_product(c, direction, reach), follow);
      };
      const Vectors next{advance(along_x, cell.x, x0.x, dx.x, sign.x, top.x),
                         advance(along_y, cell.y, x0.y, dx.y, sign.y, top.y),
                         advance(along_z, cell.z, x0.z, dx.z, sign.z, top.z)};
      const auto within = [&](Floats c, Floats last) {
        return hn::And(hn::Ge(c, zero), hn::Le(c, last));
      };
      const Mask inside_grid = hn::And(
          within(next.x, top.x), hn::And(within(next.y, top.y), within(next.z, top.z)));
      stepping = hn::And(stepping, hn::AndNot(ended, inside_grid));
      cell = if_then_else(stepping, next, cell);
      stepping_ = bits_of(stepping);
    } while (std::popcount(stepping_) > enough);
    cell_.store(hn::FirstN(d, lanes()), cell);
    store(word, word_);
  }

  // Tests the triangles of the cells that lanes have reached.
  HWY_INLINE void test_cells(LaneBits which, const PerLane<uint32_t>& words) {
    for (; which != 0; which &= which - 1) {
      const int lane = std::countr_zero(which);
      const uint32_t n = words[lane] & Grid::kPayload;
      const TriangleBlock* const blocks = grid_.blocks.data();
      const Vec3f origin = origin_.at(lane), direction = direction_.at(lane);
      for (uint32_t b = grid_.first_block[n]; b < grid_.first_block[n + 1]; ++b) {
        const float t = nearest_in_block(blocks[b], origin, direction, side_[lane], t_min_[lane],
                                         std::min(end_[lane], hit_[lane]));
        hit_[lane] = std::min(hit_[lane], t);
      }
    }
  }

  // Books what queries have found: goes on to the next query of the line, or ends it.
  void conclude(LaneBits which) {
    const FloatTag d;
    const Mask where = mask_of(which);
    const Mask inside = not_zero(load(inside_));
    const Floats hit = load(hit_), surface_t = load(surface_t_), t = load(t_);
    const Mask crossed = hn::And(where, hn::Lt(hit, hn::Min(surface_t, set(kInfinity))));
    const Mask missed = hn::AndNot(crossed, where);

    const Mask exits = hn::And(crossed, inside), entries = hn::AndNot(inside, crossed);
    const Floats end = load(end_);
    // Where the line met the surface, if it did.
    const Mask at_surface =
        hn::And(missed, hn::And(hn::Eq(end, surface_t), hn::Lt(surface_t, set(kInfinity))));
    const Floats stop = hn::Max(t, hn::IfThenElse(crossed, hit, end));
    const Floats travelled = hn::IfThenElseZero(inside, hn::Sub(stop, t));
    const Mask spent = hn::AndNot(at_surface, hn::And(missed, inside));
    const Floats in_medium =
        hn::IfThenElse(spent, load(budget_), hn::Add(load(in_medium_), travelled));
    store(where, in_medium, in_medium_);
    store(crossed, stop, t_);
    store(exits, hit, last_exit_);
    store(entries, hit, last_entry_);
    const Uints one = set(uint32_t{1});
    store(exits, hn::Zero(UintTag()), inside_);
    store(entries, one, inside_);
    store(entries, one, entered_);
    const Uints crossings = hn::Add(load(crossings_), one);
    store(crossed, crossings, crossings_);

    // Surfaces that a line met before its start end it there.
    const Vectors place = origin_.load() + direction_.load() * end;
    const Mask lost =
        hn::Or(hn::AndNot(may_be_inside(place), spent),
               hn::And(crossed, hn::RebindMask(d, hn::Gt(crossings, set(kMaxCrossings)))));
    Uints how = set(uint32_t{Rays::kEscaped});
    how = hn::IfThenElse(for_uints(at_surface), set(uint32_t{Rays::kSurface}), how);
    how = hn::IfThenElse(for_uints(spent), set(uint32_t{Rays::kSpent}), how);
    how = hn::IfThenElse(for_uints(lost), set(uint32_t{Rays::kLeaked}), how);
    const LaneBits ended = bits_of(hn::Or(missed, lost));
    if (ended != 0) {
      end_lines(ended, how, at_surface, place);
    }
    busy_ &= ~ended;
  }

  // Whether what the grid knows allows that points lie in the medium.
  Mask may_be_inside(Vectors p) const {
    const Uints word = load(word_);
    const Mask denied = hn::Not(not_zero(hn::And(word, set(Grid::kOccupied | Grid::kInside))));
    const float margin = 16 * FLT_EPSILON * boundary_.extent;
    const auto within = [&](Floats v, float low, float high) {
      return hn::And(hn::Ge(v, set(low - margin)), hn::Le(v, set(high + margin)));
    };
    const Bounds& box = boundary_.bounds;
    return hn::AndNot(denied, hn::And(within(p.x, box.min.x, box.max.x),
                                      hn::And(within(p.y, box.min.y, box.max.y),
                                              within(p.z, box.min.z, box.max.z))));
  }

  // Writes results. A point on a surface is put into the plane of its triangle, so that a level
  // floor stays level.
  void end_lines(LaneBits ended, Uints how, Mask at_surface, Vectors place) {
    const Uints surface =
        hn::IfThenElse(for_uints(at_surface), load(surface_), set(Surfaces::kNone));
    if (!hn::AllFalse(FloatTag(), at_surface)) {
      const Surfaces& surfaces = boundary_.surfaces;
      const Ints index = hn::BitCast(
          IntTag(), hn::IfThenElseZero(for_uints(at_surface), load(surface_)));
      const auto gather = [&](const Surfaces::Vectors& v) {
        return Vectors{hn::GatherIndex(FloatTag(), v.x.data(), index),
                       hn::GatherIndex(FloatTag(), v.y.data(), index),
                       hn::GatherIndex(FloatTag(), v.z.data(), index)};
      };
      const Vectors normal = gather(surfaces.normals);
      const Floats off = dot(place - gather(surfaces.corners[0]), normal);
      place = if_then_else(at_surface, place - normal * off, place);
    }
    // Lanes that have not ended write to the spare place behind the last slot.
    const Mask mask = mask_of(ended);
    const Ints ray = hn::BitCast(
        IntTag(), hn::IfThenElse(for_uints(mask), load(ray_), set(static_cast<uint32_t>(kSlots))));
    const auto write = [&](Floats v, FloatColumn& column) {
      hn::ScatterIndex(v, FloatTag(), column.data(), ray);
    };
    const auto write_bits = [&](Uints v, UintColumn& column) {
      hn::ScatterIndex(v, UintTag(), column.data(), ray);
    };
    write(place.x, rays_.position.x);
    write(place.y, rays_.position.y);
    write(place.z, rays_.position.z);
    write(load(in_medium_), rays_.in_medium);
    write_bits(how, rays_.end);
    write_bits(load(entered_), rays_.entered);
    write_bits(load(inside_), rays_.inside);
    write_bits(surface, rays_.surface);
  }

  // More crossings than this on one line mean that rounding has trapped it.
  static constexpr uint32_t kMaxCrossings = 100000;

  const Boundary& boundary_;
  const Grid& grid_;
  Rays& rays_;
  const size_t count_;
  size_t next_ray_ = 0;
  LaneBits busy_ = 0;      // lanes that have a line
  LaneBits stepping_ = 0;  // lanes whose query is under way

  // By lane; values of lanes without a line are never used, but are loaded.
  PerLaneVectors origin_{}, direction_{};
  PerLaneVectors cells_origin_{};     // in cells from the grid's corner
  PerLaneVectors cells_direction_{};  // in cells per mm
  PerLaneVectors mm_per_cell_{};
  PerLaneVectors cell_{};
  alignas(64) PerLane<float> slack_{}, t_{}, in_medium_{}, budget_{};
  alignas(64) PerLane<float> last_exit_{}, last_entry_{};
  alignas(64) PerLane<float> t_min_{}, end_{}, grid_end_{}, hit_{}, side_{};
  alignas(64) PerLane<float> surface_t_{}, surface_from_{};
  alignas(64) PerLane<uint32_t> inside_{}, entered_{}, crossings_{}, word_{}, ray_{};
  alignas(64) PerLane<uint32_t> surface_{}, surface_known_{}, excluded_{};
};

HWY_INLINE void travel(const Boundary& boundary, Rays& rays, size_t count) {
  Traveller(boundary, rays, count).run();
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
