// Coordinates in a plane by which patterns of surfaces are looked up. A point off the plane is
// looked up at right angles to it.
#ifndef ITN_TRACER_SURFACES_PLANE_COORDINATES_H_
#define ITN_TRACER_SURFACES_PLANE_COORDINATES_H_

#include <string>

#include "common/error.h"
#include "common/geometry/pose.h"

namespace itn::tracer {

// 0 at the corner, 1 at the end of their own edge, and the same all along the other one.
struct PlaneCoordinates {
  Vec3d corner, per_u, per_v;  // mm, 1/mm

  PlaneCoordinates() = default;
  // In the coordinates of the object. Throws Error (invalid input) if the edges are parallel;
  // `kind` is what they are of.
  PlaneCoordinates(const Pose& pose, const std::string& kind, Vec3d origin, Vec3d edge_u,
                   Vec3d edge_v) {
    const Rotation<double> turn = pose.rotation.inverse();
    const Vec3d u = turn(edge_u), v = turn(edge_v), normal = cross(u, v);
    if (!(length(normal) > 1e-6 * length(u) * length(v))) {
      throw invalid_input(kind + ".edge_u and edge_v are parallel; they must not be");
    }
    const double per = 1 / dot(normal, normal);
    corner = pose.to_object(origin);
    per_u = cross(v, normal) * per;
    per_v = cross(normal, u) * per;
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_SURFACES_PLANE_COORDINATES_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SURFACES_PLANE_COORDINATES_MATHS_
#undef ITN_TRACER_SURFACES_PLANE_COORDINATES_MATHS_
#else
#define ITN_TRACER_SURFACES_PLANE_COORDINATES_MATHS_
#endif

#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

struct PlanePoint {
  Floats u, v;
};
HWY_INLINE PlanePoint coordinates_of(const PlaneCoordinates& plane, Vectors p) {
  const Vectors from_corner = p - set(static_cast<Vec3f>(plane.corner));
  return {dot(from_corner, set(static_cast<Vec3f>(plane.per_u))),
          dot(from_corner, set(static_cast<Vec3f>(plane.per_v)))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
