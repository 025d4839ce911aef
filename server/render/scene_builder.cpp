#include "server/render/scene_builder.h"

#include <fmt/format.h>

#include "common/error.h"
#include "common/rpc/wire_check.h"
#include "common/scene/field_check.h"
#include "common/scene/scene_bytes.h"
#include "server/render/light_builder.h"
#include "server/render/mesh_builder.h"
#include "server/render/view_builder.h"
#include "server/tracer/scene/part_cache.h"

namespace itn {
namespace {

const ElementLimits kElementLimits = {{"itn.v1.Scene.surfaces", kMaxSurfaces},
                                      {"itn.v1.Scene.lights", kMaxLights},
                                      {"itn.v1.Mesh.transforms", kMaxTransforms}};

void check_required(const v1::Scene& scene) {
  if (!scene.has_object()) throw missing("scene.object");
  if (!scene.object().has_mesh()) throw missing("scene.object.mesh");
  if (scene.lights().empty()) throw missing("scene.lights: at least one");
  if (!scene.has_camera()) throw missing("scene.camera");
  if (!scene.has_film()) throw missing("scene.film");
  integer_in("the number of scene.lights", scene.lights_size(), 1, kMaxLights);
  if (scene.object().boundary() != v1::Object::INDEX_MATCHED) {
    throw invalid_input(fmt::format("scene.object.boundary has the unknown value {}",
                                    static_cast<int>(scene.object().boundary())));
  }
}

std::string digest_of_surfaces(const v1::Scene& scene) {
  std::string bytes;
  for (const v1::Surface& surface : scene.surfaces()) {
    const std::string one = surface.SerializeAsString();
    bytes += tracer::part_key("", one.size()) + one;
  }
  return sha256(bytes);
}

}  // namespace

v1::Scene parse_scene(const std::string& bytes) {
  v1::Scene scene;
  parse_checked(bytes, "scene", kElementLimits, scene);
  return scene;
}

tracer::SceneDescription build_scene(const v1::Scene& scene, const RenderLimits& limits,
                                     tracer::PartCache* parts, const std::stop_token& stop) {
  check_required(scene);
  check_message(scene, "scene");
  tracer::SceneDescription description;
  description.film = build_film(scene.film(), limits.max_pixels);
  description.camera = build_camera(scene.camera());
  MeshBuilder meshes(limits.max_triangles, stop);
  meshes.build_object("scene.object.mesh", scene.object().mesh(), parts, description);
  for (int i = 0; i < scene.surfaces_size(); ++i) {
    description.surfaces.push_back(
        meshes.build_surface(fmt::format("scene.surfaces[{}]", i), scene.surfaces(i)));
  }
  if (parts != nullptr) description.surfaces_digest = digest_of_surfaces(scene);
  for (int i = 0; i < scene.lights_size(); ++i) {
    description.lights.push_back(build_light(fmt::format("scene.lights[{}]", i), scene.lights(i)));
  }
  return description;
}

}  // namespace itn
