// Finds where a straight line crosses the boundary of the medium and meets surfaces.
//
// Rounding makes a point near the boundary lie on either side of it, and the order of crossings
// that nearly coincide uncertain. Three rules keep a line consistent:
//   1. Inside the medium only exits count (normal . direction > 0), outside only entries.
//   2. A line has one origin; crossings are found at growing distance along it: an exit no earlier
//      than the entry before it less `slack` and after every earlier exit, an entry likewise. So
//      coincident faces are met in order, and as both strictly grow, every line ends.
//   3. `slack`, a few units in the last place of the coordinates, also reaches behind the origin,
//      so that a point that rounding has put just beyond the boundary still finds its crossing
//      there.
// A line that stops at the boundary forgets what it has crossed:
//   4. Inside, a line from the boundary meets no surface within `slack`, which this part may stand
//      on, and no exit there that faces the other way: that is of a part which touches this one.
//   5. Between a surface and a boundary within `slack` of each other there is a gap: the boundary
//      is met first from inside, the surface from outside.
#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/vec.h"
#include "server/tracer/geometry/intersector.h"
#include "server/tracer/surfaces/surface.h"

namespace itn::tracer {

// A point that a line starts from or ends at, and what it is at.
struct Interaction {
  Vec3f position;
  bool inside = false;       // the medium
  SurfaceTriangle on;        // the triangle it lies on, which a line from it cannot meet again
  bool at_boundary = false;  // a line that stops there ended here,
  Vec3f normal = {};         // where its triangle has this normal, outwards
};

// How a straight line through the scene ended.
struct RayResult {
  enum class End {
    kInMedium,  // the path length in the medium reached max_medium_length
    kSurface,   // met an opaque surface
    kEscaped,   // left the scene, or came as far as it should
    kLeaked,    // no exit in front though believed inside: rounding has misplaced the point
    kCrossing   // met the boundary, where it was to stop
  } end = End::kEscaped;
  Interaction at;           // where it ended, before a crossing; not set if escaped or leaked
  float medium_length = 0;  // length travelled inside the medium, in mm
  bool entered = false;     // the medium was entered, or at its boundary, or started in
  // Set if it ended in a crossing: the triangle of the object's mesh, the barycentric coordinates
  // of its second and third corner, and its normal of unit length, outwards.
  uint32_t triangle = SurfaceTriangle::kNone;
  float v = 0, w = 0;
  Vec3f normal;
};

class Geometry {
 public:
  // The object bounds a volume (validate_closed).
  Geometry(const Mesh& object, const std::vector<DiffuseSurface>& surfaces);
  ~Geometry();
  Geometry(const Geometry&) = delete;
  Geometry& operator=(const Geometry&) = delete;

  // Follows a straight line until `max_medium_length` mm of it lie in the medium, or to a surface,
  // or for `distance` mm, or out of the scene. `direction` is of unit length. Stops at the
  // boundary, or passes it.
  RayResult follow(const Interaction& from, Vec3f direction, float max_medium_length,
                   bool stops_at_boundary = false,
                   float distance = std::numeric_limits<float>::infinity()) const;

  // Unit normal of a surface's triangle, on the side that `direction` arrives at.
  Vec3f facing_normal(SurfaceTriangle at, Vec3f direction) const;

  size_t memory() const;

 private:
  // False if a point certainly lies outside the medium.
  bool may_contain(Vec3f point) const;
  Interaction surface_interaction(const Line& line, const Hit& hit, bool inside) const;

  std::unique_ptr<Intersector> intersector_;
  std::vector<Mesh> surfaces_;
  std::vector<std::vector<Vec3f>> surface_normals_;  // of every triangle
  Bounds bounds_;
  float extent_;  // largest absolute coordinate of the object
};

}  // namespace itn::tracer
