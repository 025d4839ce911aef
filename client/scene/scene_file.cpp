#include "client/scene/scene_file.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "client/geometry/mesh_file.h"
#include "client/geometry/mesh_repair.h"
#include "client/scene/panorama_file.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/geometry/mesh.h"
#include "common/geometry/shapes.h"
#include "common/scene/field_check.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMaxSceneFileBytes = uint64_t{256} << 20;

v1::Scene parse(const fs::path& path) {
  const std::string text = read_file_or_stdin(path, "scene", kMaxSceneFileBytes);
  const std::string name = path == "-" ? "standard input" : path.string();
  v1::Scene scene;
  parse_text_proto(text, name, scene);
  if (scene.ByteSizeLong() == 0) {
    throw invalid_input(fmt::format(
        "{}: the scene file is empty; it needs an object, lights, a camera and a film", name));
  }
  return scene;
}

Mesh load_repaired_mesh(const fs::path& path) {
  MeshRepair repair = repaired(load_mesh(path), path.string());
  if (repair.changed()) spdlog::warn("{} is repaired: {}", path.string(), repair.describe());
  return std::move(repair.mesh);
}

// The worker would find out, too, but knows no files.
Mesh load_closed_mesh(const fs::path& path) {
  Mesh mesh = load_mesh(path);
  require_closed(
      mesh, path.string(),
      fmt::format("mesh {{ path: \"{}\" repair: true }} in a scene, or --repair of itn fit",
                  path.filename().string()));
  return mesh;
}

float mm_per(v1::LengthUnit unit) {
  switch (unit) {
    case v1::MM: return 1;
    case v1::CM: return 10;
    case v1::M: return 1000;
    case v1::INCH: return 25.4F;
    default:
      throw invalid_input(fmt::format("a mesh has the unknown unit {}", static_cast<int>(unit)));
  }
}

enum class Role { kObject, kSurface };  // which need not be closed

void resolve(v1::Mesh& mesh, Role role, const fs::path& folder) {
  if (mesh.has_path()) {
    const fs::path path = folder / mesh.path();
    const auto load = mesh.repair()           ? load_repaired_mesh
                      : role == Role::kObject ? load_closed_mesh
                                              : load_mesh;
    Mesh loaded = load(path);
    if (mesh.unit() != v1::MM) {
      for (Vec3f& vertex : loaded.vertices) vertex = vertex * mm_per(mesh.unit());
    }
    set_triangles(mesh, loaded);
    mesh.clear_repair();
    mesh.clear_unit();
  } else if (mesh.repair()) {
    throw invalid_input("repair is set for a mesh without a path; only files are repaired");
  } else if (mesh.unit() != v1::MM) {
    throw invalid_input("unit is set for a mesh without a path; built-in shapes are in mm");
  } else if (mesh.has_builtin()) {
    check_shape_name(mesh.builtin());  // the worker builds it
  }
}

void resolve(v1::EnvironmentMap& map, const fs::path& folder) {
  if (map.has_path()) *map.mutable_pixels() = load_panorama(folder / map.path());
}

void resolve(v1::ImageReflectance& image, const fs::path& folder) {
  if (image.has_path()) *image.mutable_pixels() = load_reflectances(folder / image.path());
}

}  // namespace

v1::Scene load_scene(const fs::path& path, std::optional<v1::LengthUnit> mesh_unit) {
  v1::Scene scene = parse(path);
  load_files(scene, path.parent_path(), mesh_unit);
  return scene;
}

void load_files(v1::Scene& scene, const fs::path& folder, std::optional<v1::LengthUnit> mesh_unit) {
  // Before files are read for each of them.
  integer_in("the number of lights", scene.lights_size(), 0, kMaxLights);
  integer_in("the number of surfaces", scene.surfaces_size(), 0, kMaxSurfaces);
  integer_in("the number of other_objects", scene.other_objects_size(), 0, kMaxOtherObjects);
  const auto resolve_mesh = [&](v1::Mesh& mesh, Role role) {
    if (mesh_unit && mesh.has_path()) mesh.set_unit(*mesh_unit);
    resolve(mesh, role, folder);
  };
  if (scene.object().has_mesh()) {
    resolve_mesh(*scene.mutable_object()->mutable_mesh(), Role::kObject);
  }
  for (v1::Object& object : *scene.mutable_other_objects()) {
    if (object.has_mesh()) resolve_mesh(*object.mutable_mesh(), Role::kObject);
  }
  for (v1::Surface& surface : *scene.mutable_surfaces()) {
    if (surface.has_mesh()) resolve_mesh(*surface.mutable_mesh(), Role::kSurface);
    if (surface.has_image()) resolve(*surface.mutable_image(), folder);
  }
  for (v1::Light& light : *scene.mutable_lights()) {
    if (light.has_environment_map()) resolve(*light.mutable_environment_map(), folder);
  }
}

}  // namespace itn
