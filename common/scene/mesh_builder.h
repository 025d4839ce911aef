// Meshes of a scene from the messages that describe them.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/pose.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// Builds meshes as long as all of them together stay within the limit of triangles. All functions
// throw Error as in common/scene/field_check.h, and kCancelled soon after a stop is asked for.
// `field` names the message.
class MeshBuilder {
 public:
  explicit MeshBuilder(uint64_t max_triangles, std::stop_token stop = {})
      : max_triangles_(max_triangles), stop_(std::move(stop)) {}

  // The mesh after all its transforms, in mm. Normals at corners are refused.
  Mesh build(const std::string& field, const v1::Mesh& proto);
  // The mesh in coordinates of its own: after the transforms that come before its pose.
  Mesh build_unposed(const std::string& field, const v1::Mesh& proto);
  // The normals at the corners of what build_unposed() returns, which has so many triangles; none,
  // where the message has none.
  std::vector<std::array<Vec3f, 3>> unposed_corner_normals(const std::string& field,
                                                           const v1::Mesh& proto, size_t triangles);
  // Counts triangles of what is not built here.
  void count(uint64_t triangles);

 private:
  Mesh transformed_source(const std::string& field, const v1::Mesh& proto, int end);
  Mesh source(const std::string& field, const v1::Mesh& proto);
  const Mesh& shape(const std::string& name);
  Mesh from_triangles(const std::string& field, const v1::Triangles& proto);

  uint64_t max_triangles_;
  std::stop_token stop_;
  uint64_t triangles_ = 0;
  std::map<std::string, Mesh> shapes_;  // built-in ones
};

// The rotations and translations that are a mesh's last transforms. Throws Error (invalid input).
Pose pose_of(const std::string& field, const v1::Mesh& proto);
// The number of the first transform of the pose; that of all transforms, where there is no pose.
int first_of_pose(const v1::Mesh& proto);

// The number of triangles that the message has, those that repeat a vertex among them.
uint64_t triangle_count(const v1::Triangles& proto);

// Throws Error (invalid input) unless all vertices are within 10^6 mm of the origin.
void check_extent(const std::string& field, const Mesh& mesh, const Pose& pose = {});

// The bounds of an object after its transforms, in mm, however many triangles it has; `field` names
// the object. Throws Error (invalid input).
Bounds object_bounds(const std::string& field, const v1::Object& object);

// The longest side of an object as it lies before it is posed, in mm. Throws Error (invalid input).
double unposed_size(const std::string& field, const v1::Object& object);

}  // namespace itn
