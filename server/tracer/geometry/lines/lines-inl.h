// What is known of the lines under way.
#if defined(ITN_TRACER_GEOMETRY_LINES_LINES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_LINES_LINES_INL_H_
#undef ITN_TRACER_GEOMETRY_LINES_LINES_INL_H_
#else
#define ITN_TRACER_GEOMETRY_LINES_LINES_INL_H_
#endif

#include <array>
#include <cstddef>

#include "server/tracer/geometry/obstacles.h"
#include "server/tracer/geometry/rays.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Lines that are followed at a time: several vectors full.
constexpr size_t kLines = 64;

using LineBits = Bits;
constexpr LineBits kAllLines = ~LineBits{0} >> (64 - kLines);

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

// By line; values of free lines are never used, but are loaded. Distances are along the line, in
// mm, from an origin that lies a little behind its start (rule 3 of geometry/line_geometry.h).
struct Lines {
  PerLine<uint32_t> ray{};  // that the line follows

  // The origin and the direction of the line.
  PerLineVectors origin{}, direction{};
  PerLineVectors cells_origin{};     // in cells from the grid's corner
  PerLineVectors cells_direction{};  // in cells per mm
  PerLineVectors mm_per_cell{};
  PerLine<uint32_t> octant{};    // of the direction
  PerLine<uint32_t> steepest{};  // axis that the line is nearest to
  PerLine<float> slack{}, max_medium_length{};
  PerLine<float> first{};  // from where on surfaces can be met
  PerLine<float> reach{};  // where it ends, if rays are bounded

  // How far it has come, where it last left and entered the medium, and what it knows of surfaces.
  PerLine<float> t{}, medium_length{};
  PerLine<float> last_exit{}, last_entry{};
  PerLine<uint32_t> inside{}, entered{}, crossings{};
  PerLine<float> surface_t{};
  PerLine<uint32_t> surface{}, surface_unknown{}, excluded{};

  // What is asked of it: the part of the line that is looked at, that within the grid, the nearest
  // crossing, and which kind counts: 1 exits, -1 entries.
  PerLine<float> t_min{}, end{}, grid_end{}, hit{}, side{};
  // The cell that it is in, where it entered that, its word, and the edge of the empty cube ahead.
  PerLineVectors cell{};
  PerLine<float> entered_cell{}, skip{};
  PerLine<uint32_t> word{};
};

// Whether interactions (Rays) are inside the medium.
HWY_INLINE Mask is_inside(Uints interaction) {
  return not_zero(interaction & set(Rays::kInside));
}

// What lines do at the boundary of the medium, known when the code is compiled: they pass, and note
// nothing.
struct PassBoundary {
  static constexpr bool kStops = false;
  struct LineCrossings {};
};

// They stop.
struct StopAtBoundary {
  static constexpr bool kStops = true;

  // What lines under way know in addition.
  struct LineCrossings {
    // The nearest hit: the triangle, as its block * kSize + place in it; the number of the cell;
    // and the barycentric coordinates times a common factor.
    PerLine<uint32_t> hit{}, cell{};
    PerLineVectors sides{};
    // The crossing that a line ends in.
    PerLine<uint32_t> triangle{};
    PerLineVectors point{}, normal{}, smooth_normal{};
    PerLineVectors start_normal{};  // Rays::normal
  };
};

// Follows the first `count` rays. They stop at the boundary, and say where, if `at_boundary` is not
// null. Compiled in follow.cpp, apart from the walk.
void follow_lines(const Obstacles& obstacles, Rays& rays, size_t count, Report report,
                  Crossings* at_boundary);

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
