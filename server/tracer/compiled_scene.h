// The form of a scene that is rendered. Internal to the tracer.
#pragma once

#include "server/tracer/camera.h"
#include "server/tracer/geometry.h"
#include "server/tracer/lights.h"
#include "server/tracer/scene.h"

namespace itn::tracer {

struct Scene::Compiled {
  Geometry geometry;
  std::vector<float> reflectances;  // of every surface
  Lights lights;
  Camera camera;
  FilmDescription film;
  bool camera_inside;  // the medium
};

}  // namespace itn::tracer
