// Meshes of a scene off the wire.
#pragma once

#include <cstdint>
#include <map>
#include <stop_token>
#include <string>
#include <utility>

#include "common/geometry/mesh.h"
#include "common/part_cache.h"
#include "itn/v1/scene.pb.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// Builds meshes as long as all of them together stay within the limit of triangles. All functions
// throw Error as in common/scene/field_check.h, and kCancelled soon after a stop is asked for.
class MeshBuilder {
 public:
  explicit MeshBuilder(uint64_t max_triangles, std::stop_token stop = {})
      : max_triangles_(max_triangles), stop_(std::move(stop)) {}

  Mesh build(const std::string& field, const v1::Mesh& proto);
  // The object in coordinates of its own, and its pose: the rotations and translations that come
  // last. With `parts`, sets its key, and takes it from there if it is held.
  void build_object(const std::string& field, const v1::Mesh& proto, PartCache* parts,
                    tracer::SceneDescription& description);
  tracer::DiffuseSurface build_surface(const std::string& field, const v1::Surface& proto);

 private:
  void count(uint64_t triangles);
  Mesh own_coordinates(const std::string& field, const v1::Mesh& proto, int end);
  Mesh source(const std::string& field, const v1::Mesh& proto);
  const Mesh& shape(const std::string& name);
  Mesh from_triangles(const std::string& field, const v1::Triangles& proto);
  // After the transforms before number `end`, for a mesh of so many triangles.
  std::vector<std::array<Vec3f, 3>> corner_normals(const std::string& field, const v1::Mesh& proto,
                                                   int end, size_t triangles);

  uint64_t max_triangles_;
  std::stop_token stop_;
  uint64_t triangles_ = 0;
  std::map<std::string, Mesh> shapes_;  // built-in ones
};

// `smooth_angle_degrees` of a field, in radians. Throws Error (invalid input).
double build_smooth_angle(const std::string& field, double degrees);

// The bounds of an object after its transforms, in mm, however many triangles it has; `field` names
// it.
Bounds object_bounds(const std::string& field, const v1::Object& object);

}  // namespace itn
