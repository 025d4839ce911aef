// The form of a scene that is rendered. Internal to the tracer.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "server/tracer/lights/light_tables.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/reference/geometry.h"
#include "server/tracer/scene/camera.h"
#include "server/tracer/scene/scene.h"
#include "server/tracer/wavefront/boundary.h"

namespace itn::tracer {

// Where a camera's ray is followed from: the depth at which the box of the object begins, so that
// its entry is as precise as the object's coordinates, or the camera where the ray misses the box's
// image or meets a surface before.
struct CameraRay {
  Vec3f origin, direction;
};

struct Scene::Compiled {
  explicit Compiled(SceneDescription&& scene);

  // Through film position (x, y), in pixels.
  CameraRay camera_ray(double x, double y) const;

  // What the reference renders with; made when first asked for.
  const Geometry& geometry() const;

  // The pixels that see the object, in order: those where one of kMaskRays x kMaskRays camera rays,
  // spread evenly over the pixel, meets it. Made when first asked for.
  const std::vector<uint32_t>& object_pixels() const;
  static constexpr int kMaskRays = 4;

  size_t memory() const;

  Mesh object;
  std::vector<DiffuseSurface> surfaces;
  Boundary boundary;
  Lights lights;
  LightTables light_tables;
  Camera camera;
  FilmDescription film;
  bool camera_inside;        // the medium
  Bounds box;                // of the object, a little enlarged
  Camera::FilmBox film_box;  // of that box

 private:
  std::vector<uint32_t> find_object_pixels() const;

  mutable std::once_flag geometry_once_, object_pixels_once_;
  mutable std::unique_ptr<const Geometry> geometry_;
  mutable std::vector<uint32_t> object_pixels_;
};

}  // namespace itn::tracer
