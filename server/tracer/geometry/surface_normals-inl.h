// Normals of opaque surfaces that are smooth.
#if defined(ITN_TRACER_GEOMETRY_SURFACE_NORMALS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_SURFACE_NORMALS_INL_H_
#undef ITN_TRACER_GEOMETRY_SURFACE_NORMALS_INL_H_
#else
#define ITN_TRACER_GEOMETRY_SURFACE_NORMALS_INL_H_
#endif

#include "server/tracer/geometry/surface_triangles.h"
#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Vectors gather(const Surfaces::Vectors& vectors, Ints at) {
  return {gather(vectors.x.data(), at), gather(vectors.y.data(), at), gather(vectors.z.data(), at)};
}

// At points of triangles, by their barycentric coordinates, of unit length. Only where some
// surfaces are smooth().
HWY_INLINE Vectors smooth_normal_at(const Surfaces& surfaces, Ints triangle, Vectors p) {
  const Vectors a = gather(surfaces.corners[0], triangle);
  const Vectors to_b = gather(surfaces.corners[1], triangle) - a;
  const Vectors to_c = gather(surfaces.corners[2], triangle) - a, to_p = p - a;
  const Vectors n = cross(to_b, to_c);
  const Floats by_area = 1 / hn::Max(dot(n, n), set(1e-30F));
  const auto part = [&](Vectors area) {
    return hn::Clamp(dot(area, n) * by_area, hn::Zero(FloatTag()), set(1.0F));
  };
  const Floats v = part(cross(to_p, to_c)), w = part(cross(to_b, to_p));
  const Floats u = 1 - v - w;
  return normalize(gather(surfaces.corner_normals[0], triangle) * u +
                   gather(surfaces.corner_normals[1], triangle) * v +
                   gather(surfaces.corner_normals[2], triangle) * w);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
