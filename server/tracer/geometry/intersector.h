// Ray queries against the boundary of the medium and the opaque surfaces, by Embree.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/vec.h"

namespace itn::tracer {

// A triangle of one of the opaque surfaces.
struct SurfaceTriangle {
  static constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  uint32_t surface = kNone;
  uint32_t triangle = kNone;
};

// A line in the form that it is queried in. Its origin lies a little behind its start, so that
// distances along it are positive even where a query looks behind the start.
struct Line {
  Vec3f origin, direction;   // of unit length
  float start;               // distance from `origin` at which the line starts
  float slack;               // uncertainty of distances along it
  SurfaceTriangle excluded;  // that the line starts on, and cannot meet again

  // `extent`: largest absolute coordinate of the object.
  Line(Vec3f position, Vec3f unit, SurfaceTriangle on, float extent);
  Vec3f at(float t) const { return origin + direction * t; }
};

// Which crossings of the boundary a query looks for; surfaces count, but for the last.
enum class Wanted { kExit, kEntry, kSurfaceOnly, kExitOnly };

struct Hit {
  float t = std::numeric_limits<float>::infinity();
  bool found = false;
  SurfaceTriangle surface;  // kNone: a crossing of the boundary
  // The object's triangle at a crossing, and the barycentric coordinates of its second and third
  // corner.
  uint32_t triangle = SurfaceTriangle::kNone;
  float v = 0, w = 0;

  bool on_surface() const { return surface.surface != SurfaceTriangle::kNone; }
};

class Intersector {
 public:
  virtual ~Intersector() = default;
  // The closest wanted hit at a distance in [t_min, t_max], found to within line.slack.
  virtual Hit closest(const Line& line, float t_min, float t_max, Wanted wanted) const = 0;
  // The place of a crossing by its barycentric coordinates, as near to the boundary as can be
  // however far the line has come, and the outward normal, of unit length.
  struct Crossing {
    Vec3f point, normal;
  };
  virtual Crossing crossing(const Hit& hit) const = 0;
  virtual size_t memory() const = 0;
};

// `object` may be empty.
std::unique_ptr<Intersector> make_embree_intersector(const Mesh& object,
                                                     const std::vector<Mesh>& surfaces);

}  // namespace itn::tracer
