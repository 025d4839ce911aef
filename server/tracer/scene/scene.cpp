#include "server/tracer/scene/scene.h"

#include <fmt/format.h>

#include <limits>

#include "common/error.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {
namespace {

void check(const SceneDescription& scene) {
  if (scene.film.width < 1 || scene.film.height < 1 ||
      static_cast<int64_t>(scene.film.width) * scene.film.height >
          std::numeric_limits<int32_t>::max()) {
    throw invalid_input(
        fmt::format("film: {} x {} pixels; each must be at least 1, both below 2^31",
                    scene.film.width, scene.film.height));
  }
  validate_triangles(scene.object, "object");
  validate_closed(scene.object, "object");
  for (size_t i = 0; i < scene.surfaces.size(); ++i) {
    const DiffuseSurface& surface = scene.surfaces[i];
    validate_triangles(surface.mesh, fmt::format("surfaces[{}]", i));
    if (!(surface.reflectance >= 0 && surface.reflectance <= 1)) {
      throw invalid_input(fmt::format("surfaces[{}]: reflectance is {}; it must be in [0, 1]", i,
                                      surface.reflectance));
    }
  }
}

std::unique_ptr<const Scene::Compiled> compile(SceneDescription&& scene) {
  check(scene);
  return std::make_unique<const Scene::Compiled>(std::move(scene));
}

}  // namespace

Scene::Scene(SceneDescription description) : compiled_(compile(std::move(description))) {}
Scene::~Scene() = default;

int Scene::width() const {
  return compiled_->film.width;
}
int Scene::height() const {
  return compiled_->film.height;
}

size_t Scene::surface_count() const {
  return compiled_->surfaces.size();
}
size_t Scene::light_count() const {
  return compiled_->lights.count();
}

size_t Scene::memory() const {
  return compiled_->memory();
}

}  // namespace itn::tracer
