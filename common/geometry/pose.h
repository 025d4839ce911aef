// The pose of an object: a rotation, then a translation.
#pragma once

#include "common/geometry/mesh.h"
#include "common/vec.h"

namespace itn {

struct Pose {
  Rotation<double> rotation;
  Vec3d translation{};

  Vec3d to_scene(Vec3d p) const { return rotation(p) + translation; }
  Vec3d to_object(Vec3d p) const { return rotation.inverse()(p - translation); }
};

// A mesh of the scene in the coordinates of the object.
inline Mesh to_object(const Pose& pose, Mesh mesh) {
  for (Vec3f& v : mesh.vertices) v = static_cast<Vec3f>(pose.to_object(static_cast<Vec3d>(v)));
  return mesh;
}

}  // namespace itn
