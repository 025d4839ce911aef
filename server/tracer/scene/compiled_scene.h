// The form of a scene that is rendered. Internal to the tracer.
#pragma once

#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "common/part_cache.h"
#include "server/tracer/geometry/line_geometry.h"
#include "server/tracer/geometry/object.h"
#include "server/tracer/geometry/obstacles.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/scene/camera.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

struct ObjectPixels;

// The point from which a camera's ray is followed: the depth at which the box of the object begins,
// so that its entry is as precise as the object's coordinates, or the camera where the ray misses
// the box's image or meets a surface before.
struct CameraRay {
  Vec3f origin, direction;
};

// All in the coordinates of the object's mesh.
struct Scene::Compiled {
  // The object is compiled, with the others behind it. `parts` lives longer. Throws Error
  // (cancelled).
  Compiled(SceneDescription&& scene, PartCache& parts, const std::stop_token& stop);

  // Through film position (x, y), in pixels.
  CameraRay camera_ray(double x, double y) const;

  // The boundary of a medium: see camera_medium.
  const Boundary& boundary_of(size_t medium) const {
    return medium == 0 ? boundary : other_media[medium - 1].boundary;
  }

  // The number of the medium that a triangle bounds.
  size_t medium_at(uint32_t triangle) const {
    size_t medium = 0;
    while (medium < other_media.size() && triangle >= other_media[medium].first_triangle) ++medium;
    return medium;
  }

  // The number of triangles of the object alone, which come first in its mesh.
  size_t object_triangles() const {
    return other_media.empty() ? object->mesh.triangles.size() : other_media[0].first_triangle;
  }

  // What the reference renders with; made when first asked for.
  const Geometry& geometry() const;

  // The pixels that see the object, in order (see ObjectPixels); found when first asked for, on
  // `threads` threads, 0: all. Throws Error (cancelled).
  const std::vector<uint32_t>& object_pixels(int threads = 0,
                                             const std::stop_token& stop = {}) const;

  // Without what is shared.
  size_t memory() const;

  std::shared_ptr<const Object> object;  // with the other objects behind it in the mesh
  Boundary boundary;
  // The medium of another object; its triangles are those from `first_triangle` on.
  struct OtherMedium {
    uint32_t first_triangle;
    Material material;
    Boundary boundary;
  };
  std::vector<OtherMedium> other_media;
  // Reflectances of all surfaces, by colour; empty unless the film shows kRgb.
  std::vector<std::vector<Reflectance>> colour_reflectances;
  std::vector<DiffuseSurface> surfaces;
  std::vector<std::string> part_keys;  // of all parts that the scene holds, or will
  Obstacles obstacles;
  Lights lights;
  Camera camera;
  FilmDescription film;
  bool camera_inside;    // a medium
  size_t camera_medium;  // 0: the object's, else that of other_media[camera_medium - 1]
  // The radiance at the camera over that which paths count (boundary/crossing-inl.h).
  float camera_weight;
  float camera_score;        // the derivative of its logarithm in the index of the object
  Bounds box;                // of the object, a little enlarged
  Camera::FilmBox film_box;  // of that box

 private:
  PartCache& parts_;
  bool object_is_shared_;
  std::string geometry_key_, object_pixels_key_;
  mutable std::mutex mutex_;  // of what is made when first asked for
  mutable std::shared_ptr<const Geometry> geometry_;
  mutable std::shared_ptr<const ObjectPixels> object_pixels_;
};

}  // namespace itn::tracer
