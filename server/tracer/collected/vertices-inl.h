// The vertices where paths have arrived.
#if defined(ITN_TRACER_COLLECTED_VERTICES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_VERTICES_INL_H_
#undef ITN_TRACER_COLLECTED_VERTICES_INL_H_
#else
#define ITN_TRACER_COLLECTED_VERTICES_INL_H_
#endif

#include <cstdint>

#include "server/tracer/boundary/crossing-inl.h"
#include "server/tracer/geometry/surface_triangles.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Whether triangles are of a range: from `first` on, and before `end`.
HWY_INLINE Mask among(Surfaces::Range range, Ints triangles) {
  const auto below = [](uint32_t n) { return hn::Set(IntTag(), static_cast<int32_t>(n) - 1); };
  return hn::RebindMask(FloatTag(),
                        hn::AndNot(triangles > below(range.end), triangles > below(range.first)));
}

// The vertices where paths that are sent on have arrived.
struct Vertices {
  Mask in_medium, on_surface, at_boundary;  // scatterings, diffuse reflections, crossings
  Uints medium;                             // that is, or the boundary is of
  bool any_on_surface, any_at_boundary;
  Crossing crossing;  // if there is any
  Vectors axis;  // that the next direction is drawn around: the last one, or the surface's normal
  Vectors flat_normal;  // of surfaces, on the side that paths arrive at, where some are smooth
  Floats factor;        // albedo or reflectance; at a boundary 1
  Ints triangles;       // that reflect, or -1

  Mask where() const { return in_medium | on_surface | at_boundary; }
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
