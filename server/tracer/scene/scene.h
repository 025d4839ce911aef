// What the tracer renders: a homogeneous medium inside a closed mesh, maybe others inside others,
// opaque diffuse surfaces, lights, a pinhole camera. Plain data, and the compiled form that rays
// are traced against.
//
// A scene is compiled in the coordinates of its object: what costs most, the object, does not
// depend on its pose then, which moves camera, surfaces and lights instead. So parts are shared by
// scenes (PartCache): an object in many poses, a sky with the sun at any azimuth, the pixels of a
// view.
//
// Right-handed, y up; lengths in mm; angles in radians; radiance in W/(m^2 sr) on the scale of the
// lights.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/pose.h"
#include "common/material.h"
#include "common/vec.h"
#include "server/tracer/boundary/boundary.h"
#include "server/tracer/lights/kinds.h"
#include "server/tracer/surfaces/surface.h"

namespace itn {
class PartCache;
}

namespace itn::tracer {

class Object;

struct CameraDescription {
  Vec3d origin;
  Vec3d target;
  Vec3d up{0, 1, 0};
  double fov = 0.698;  // horizontal, of an image whose middle is the principal point
  // The point where the view axis meets the image, in parts of its width and height from the left
  // and top.
  double principal_x = 0.5, principal_y = 0.5;
  // Radial distortion: what lies at a distance r from the principal point, in focal lengths, is
  // seen at r (1 + k_1 r^2 + k_2 r^4).
  double k_1 = 0, k_2 = 0;
  // The part of the image that the film shows, in parts of its width and height.
  double left = 0, top = 0, right = 1, bottom = 1;
};

struct FilmDescription {
  int width = 0;
  int height = 0;
  Channel channel = Channel::kLuminance;
};

// A translucent thing beside the object, of a medium that no derivative is asked for in.
struct OtherObject {
  Mesh mesh;  // closed, outward oriented; touches object and others at most
  Material material = {};
  Boundary boundary = {};  // of the kind that the object's is, one that stops lines
  double smooth_angle = 0;
};

struct SceneDescription {
  Mesh object;  // closed, outward oriented; in coordinates of its own
  // The same, compiled before; `object` is not looked at then.
  std::shared_ptr<const Object> compiled_object = nullptr;
  Pose pose = {};  // of the object
  Boundary boundary = {};
  // In radians: triangles that meet under less bound one smooth surface (CornerNormals), where the
  // boundary reflects and refracts. 0: flat.
  double smooth_angle = 0;
  // Instead, at the three corners of each triangle of the object, outwards, of unit length.
  std::vector<std::array<Vec3f, 3>> corner_normals = {};
  std::vector<OtherObject> other_objects = {};
  std::vector<DiffuseSurface> surfaces;
  std::vector<LightDescription> lights;
  std::vector<Rgb> light_colours = {};  // see Lights
  CameraDescription camera;
  FilmDescription film;
  // Keys, for scenes that share parts: of the compiled object, under which it is in the cache, and
  // digests of the other objects and of the surfaces. Empty: nothing that depends on them is
  // shared.
  std::string object_key = {}, other_objects_digest = {}, surfaces_digest = {};
};

// What a scene takes at most while it is checked, compiled and rendered, by its numbers of
// triangles, pixels of its panoramas and film pixels, in bytes: whatever the shapes are, for a
// service to decide by before it makes a Scene. Without the description itself, and without the
// sums of a film.
size_t estimated_memory(const SceneDescription& description);

// What the description holds itself, in bytes: meshes, normals, pixels, but no compiled object.
size_t memory_of(const SceneDescription& description);

// Compiled and immutable; may be shared by any number of renders.
class Scene {
 public:
  // Throws Error (invalid input) if the object does not bound a volume (see validate_closed), a
  // light's numbers are out of range, or the camera is degenerate; Error (cancelled) soon after a
  // stop is requested.
  explicit Scene(SceneDescription description, const std::stop_token& stop = {});
  // Shares what it can with other scenes of the cache, which must live longer. Renders are the
  // same, bit for bit, whatever the cache holds.
  Scene(SceneDescription description, PartCache& parts, const std::stop_token& stop = {});
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  int width() const;
  int height() const;
  size_t surface_count() const;
  size_t light_count() const;
  // Rough size in memory, in bytes, for caches, without the parts that are shared; and their keys.
  size_t memory() const;
  const std::vector<std::string>& part_keys() const;

  struct Compiled;
  const Compiled& compiled() const { return *compiled_; }

 private:
  std::unique_ptr<PartCache> own_parts_;  // of a scene that shares nothing
  std::unique_ptr<const Compiled> compiled_;
};

}  // namespace itn::tracer
