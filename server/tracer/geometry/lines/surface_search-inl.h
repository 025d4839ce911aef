// The first surface on lines.
#if defined(ITN_TRACER_GEOMETRY_LINES_SURFACE_SEARCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_LINES_SURFACE_SEARCH_INL_H_
#undef ITN_TRACER_GEOMETRY_LINES_SURFACE_SEARCH_INL_H_
#else
#define ITN_TRACER_GEOMETRY_LINES_SURFACE_SEARCH_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/tracer/geometry/lines/lines-inl.h"
#include "server/tracer/geometry/surface_triangles.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Rays::surface_of, Surfaces::kNone where there is none.
HWY_INLINE Uints surface_of(Uints interaction) {
  return hn::ShiftRight<Rays::kSurfaceBit>(interaction) - set(uint32_t{1});
}

// A length above that of any line, but not infinite: it may be multiplied by 0.
constexpr float kFar = 1e30F;

// Whether lines of this length may meet the box of the surfaces.
HWY_INLINE Mask may_hit_surfaces(const Surfaces& surfaces, Vectors position, Vectors direction,
                                 Floats length, Floats slack) {
  const Bounds& box = surfaces.bounds;
  const auto overlaps = [&](Floats p, Floats q, float low, float high) {
    return (hn::Max(p, q) + slack >= low) & (hn::Min(p, q) - slack <= high);
  };
  const Vectors to = position + direction * hn::Min(length, set(kFar));
  return overlaps(position.x, to.x, box.min.x, box.max.x) &
         overlaps(position.y, to.y, box.min.y, box.max.y) &
         overlaps(position.z, to.z, box.min.z, box.max.z);
}

// The first surface on lines, by an intersector: for surfaces of many triangles.
inline void find_many_surfaces(const Surfaces& surfaces, Lines& lines, LineBits where) {
  const auto& first = surfaces.first_triangle_of_mesh;
  for (; where != 0; where &= where - 1) {
    const int i = std::countr_zero(where);
    Line line(lines.origin.at(i), lines.direction.at(i), {}, 0);
    if (lines.excluded[i] != Surfaces::kNone) {
      const auto mesh = std::upper_bound(first.begin(), first.end(), lines.excluded[i]) - 1;
      line.excluded = {static_cast<uint32_t>(mesh - first.begin()), lines.excluded[i] - *mesh};
    }
    line.origin = lines.origin.at(i);
    const Hit hit = surfaces.many->closest(line, lines.first[i], kInfinity, Wanted::kSurfaceOnly);
    if (hit.found) {
      lines.surface_t[i] = hit.t;
      lines.surface[i] = first[hit.surface.surface] + hit.surface.triangle;
    }
  }
}

// The first surface on lines that have not looked for it yet.
inline void find_surfaces(const Surfaces& surfaces, Lines& lines, Mask where, size_t v) {
  where &= not_zero(load(lines.surface_unknown, v));
  const FloatTag d;
  if (hn::AllFalse(d, where)) return;
  store(where, hn::Zero(UintTag()), lines.surface_unknown, v);
  if (surfaces.many) {
    find_many_surfaces(surfaces, lines, bits_of(where, v));
    return;
  }
  const Vectors o = lines.origin.load(v), w = lines.direction.load(v);
  const Floats from = load(lines.first, v), zero = hn::Zero(d);
  const Uints excluded = load(lines.excluded, v);
  Floats nearest = load(lines.surface_t, v);
  Uints found = load(lines.surface, v);
  for (size_t i = 0; i < surfaces.triangles; ++i) {
    const Vectors n = set(surfaces.normals.at(i));
    const Floats cosine = dot(n, w);
    const Floats sign = hn::CopySign(set(1.0F), cosine);
    const Vec3f p = surfaces.corners[0].at(i), q = surfaces.corners[1].at(i),
                r = surfaces.corners[2].at(i);
    const Vectors a = set(p) - o, b = set(q) - o, c = set(r) - o;
    // On which side of an edge the line passes. With the edge itself, not with its two ends, the
    // rounding is in proportion to its length, so that a small triangle is met where it is. The
    // triangle beyond finds exactly the opposite.
    const auto side = [&](Vectors begin, Vectors stop, Vec3f edge) {
      return sign * dot(w, cross(begin + stop, set(edge)));
    };
    const Floats least = hn::Min(side(b, c, r - q), hn::Min(side(c, a, p - r), side(a, b, q - p)));
    const Floats t = dot(n, a) / cosine;
    const auto number = set(static_cast<uint32_t>(i));
    Mask hits = (least >= 0) & hn::Ne(cosine, zero);
    hits &= (t >= from) & (t < nearest);
    hits &= hn::RebindMask(d, hn::Ne(excluded, number));
    nearest = hn::IfThenElse(hits, t, nearest);
    found = hn::IfThenElse(for_uints(hits), number, found);
  }
  store(where, nearest, lines.surface_t, v);
  store(where, found, lines.surface, v);
}

// Surfaces are looked for once for every line whose direction leads to their box: as soon as it
// is outside, or may reach the box inside.
inline void begin_surfaces(const Surfaces& surfaces, Lines& lines, Mask fresh, size_t v,
                           Vectors position, Vectors direction, Floats max_medium_length,
                           Uints interaction) {
  const Mask inside = is_inside(interaction);
  store(fresh, surface_of(interaction), lines.excluded, v);
  const Floats slack = load(lines.slack, v);

  const Mask ever = may_hit_surfaces(surfaces, position, direction, set(kFar), slack);
  const Mask soon =
      may_hit_surfaces(surfaces, position, direction, max_medium_length, slack) | !inside;
  store(fresh, hn::IfThenElseZero(for_uints(ever), set(uint32_t{1})), lines.surface_unknown, v);
  find_surfaces(surfaces, lines, fresh & soon, v);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
