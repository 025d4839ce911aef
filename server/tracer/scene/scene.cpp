#include "server/tracer/scene/scene.h"

#include <fmt/format.h>

#include <limits>
#include <numbers>

#include "common/error.h"
#include "common/fields.h"
#include "common/part_cache.h"
#include "server/tracer/geometry/object.h"
#include "server/tracer/geometry/surface_triangles.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {
namespace {

size_t size_of(const Mesh& mesh) {
  return mesh.vertices.size() * sizeof(Vec3f) +
         mesh.triangles.size() * sizeof(std::array<uint32_t, 3>);
}

std::string name_of_object(size_t number) {
  return number == 0 ? "object" : fmt::format("other_objects[{}]", number - 1);
}

// All paths are of one kind, so all boundaries have to be.
void check_other(const std::string& name, const SceneDescription& scene, const OtherObject& other) {
  itn::validate(other.material, name + ".material");
  check_fields(name + ".", other.boundary);
  in_closed(name + ".smooth_angle", other.smooth_angle, 0, std::numbers::pi);
  const auto kind = [](const Boundary& boundary) {
    const std::string name_of_kind =
        std::visit([](const auto& of_kind) { return of_kind.kName; }, boundary);
    return name_of_kind.empty() ? "index-matched" : name_of_kind;
  };
  if (stops_lines(scene.boundary) && other.boundary.index() == scene.boundary.index()) return;
  throw invalid_input(fmt::format(
      "{} is {} and the object {}; where there are several, all of them must be "
      "{}, or all {}, with any numbers (index 1 of the first lets light pass straight)",
      name, kind(other.boundary), kind(scene.boundary), Dielectric::kName, RoughDielectric::kName));
}

// A path behind a smooth boundary meets lights by chance alone.
void check_lights_are_found(const SceneDescription& scene) {
  const auto name = [](const auto& kind) { return kind.kName; };
  for (size_t i = 0; i < scene.lights.size(); ++i) {
    if (has_size(scene.lights[i])) continue;
    throw invalid_input(fmt::format(
        "lights[{}].{} cannot be seen through object.{}, which is smooth: no path finds such a "
        "light; one of a size (angular_radius_degrees, sphere, panel), or a rough boundary, can be "
        "rendered",
        i, std::visit(name, scene.lights[i]), std::visit(name, scene.boundary)));
  }
}

void check(const SceneDescription& scene) {
  if (scene.film.width < 1 || scene.film.height < 1 ||
      static_cast<int64_t>(scene.film.width) * scene.film.height >
          std::numeric_limits<int32_t>::max()) {
    throw invalid_input(
        fmt::format("film: {} x {} pixels; each must be at least 1, both below 2^31",
                    scene.film.width, scene.film.height));
  }
  for (size_t i = 0; i < scene.surfaces.size(); ++i) {
    const DiffuseSurface& surface = scene.surfaces[i];
    validate_triangles(surface.mesh, fmt::format("surfaces[{}]", i));
    check_fields(fmt::format("surfaces[{}]: ", i), surface.reflectance);
    in_closed(fmt::format("surfaces[{}].smooth_angle", i), surface.smooth_angle, 0,
              std::numbers::pi);
  }
  check_fields("object.", scene.boundary);
  in_closed("object.smooth_angle", scene.smooth_angle, 0, std::numbers::pi);
  for (size_t k = 0; k < scene.other_objects.size(); ++k) {
    check_other(name_of_object(k + 1), scene, scene.other_objects[k]);
  }
  if (stops_lines(scene.boundary) && is_delta(scene.boundary)) check_lights_are_found(scene);
}

// What of an object's size floats have to resolve.
struct ObjectSize {
  Bounds box;
  double thickness;
  explicit ObjectSize(const Mesh& mesh) : box(bounds(mesh)), thickness(itn::thickness(mesh)) {}
  explicit ObjectSize(const Object& object) : box(object.bounds), thickness(object.thickness) {}
};

// Puts the other objects behind the object: one mesh of several parts. Returns the sizes of all.
std::vector<ObjectSize> join_objects(SceneDescription& scene, PartCache& parts,
                                     const std::stop_token& stop) {
  if (scene.compiled_object) {
    scene.object = scene.compiled_object->mesh;
  } else {
    validate_closed(scene.object, name_of_object(0), stop);
  }
  scene.compiled_object = nullptr;
  const bool has_keys = !scene.object_key.empty() && !scene.other_objects_digest.empty();
  scene.object_key =
      has_keys ? part_key("objects", scene.pose) + scene.object_key + scene.other_objects_digest
               : std::string();
  const bool known = has_keys && parts.find<Object>(scene.object_key) != nullptr;
  std::vector<ObjectSize> sizes{ObjectSize(scene.object)};
  for (OtherObject& other : scene.other_objects) {
    if (!known) validate_closed(other.mesh, name_of_object(sizes.size()), stop);
    other.mesh = to_object(scene.pose, std::move(other.mesh));
    sizes.emplace_back(other.mesh);
    Mesh& all = scene.object;
    const auto vertices = static_cast<uint32_t>(all.vertices.size());
    all.vertices.insert(all.vertices.end(), other.mesh.vertices.begin(), other.mesh.vertices.end());
    for (const auto& [a, b, c] : other.mesh.triangles) {
      all.triangles.push_back({a + vertices, b + vertices, c + vertices});
    }
  }
  return sizes;
}

// Whether floats resolve each of the objects.
void check_sizes(const SceneDescription& scene, const std::vector<ObjectSize>& sizes) {
  const double extent = double{scene.compiled_object->extent};
  for (size_t k = 0; k < sizes.size(); ++k) {
    const auto& [box, thickness] = sizes[k];
    const double size = longest_side(box);
    const Vec3d middle = middle_of(box);
    const double distance = length(scene.camera.origin - scene.pose.to_scene(middle));
    const auto require_part_of = [&](double reach, const char* what) {
      if (size >= kSmallestPart * reach) return;
      throw invalid_input(
          fmt::format("{}: its longest side is {:g} mm; it must be {:g} at least of the {}, which "
                      "is {:g} mm",
                      name_of_object(k), size, kSmallestPart, what, reach));
    };
    require_part_of(distance, "distance to the camera");
    require_part_of(extent, "distance of all objects from the origin of the first");
    if (thickness < kSmallestThickness * extent) {
      throw invalid_input(fmt::format(
          "{}: it is {:g} mm thick (twice its volume over its area); it must be {:g} mm at least, "
          "{:g} of the largest coordinate, which is {:g} mm: make it less wide",
          name_of_object(k), thickness, kSmallestThickness * extent, kSmallestThickness, extent));
    }
  }
}

// Normals that are given point outwards: one that does not would make light of its own.
void check_corner_normals(const SceneDescription& scene) {
  constexpr double kLeastCosine = 1e-3;
  const Mesh& mesh = scene.compiled_object->mesh;
  for (size_t t = 0; t < scene.corner_normals.size() && t < mesh.triangles.size(); ++t) {
    const auto corner = [&](size_t k) {
      return static_cast<Vec3d>(mesh.vertices[mesh.triangles[t][k]]);
    };
    const Vec3d across = cross(corner(1) - corner(0), corner(2) - corner(0));
    if (!(length(across) > 0)) continue;
    const Vec3d normal = itn::normalize(across);
    for (const Vec3f given : scene.corner_normals[t]) {
      const double cosine = dot(normal, static_cast<Vec3d>(given));
      if (cosine >= kLeastCosine) continue;
      throw invalid_input(
          fmt::format("object.mesh.triangles.corner_normals: one of triangle {} is ({}, {}, {}), "
                      "which does not "
                      "point outwards: its product with the triangle's own normal is {:.3g}, and "
                      "must be above 0",
                      t, given.x, given.y, given.z, cosine));
    }
  }
}

std::unique_ptr<const Scene::Compiled> compile(SceneDescription&& scene, PartCache& parts,
                                               const std::stop_token& stop) {
  check(scene);
  const bool alone = scene.other_objects.empty();
  std::vector<ObjectSize> sizes;
  if (!alone) sizes = join_objects(scene, parts, stop);
  const auto build = [&] {
    return compile_object(std::move(scene.object), alone ? "object" : "object with other_objects",
                          stop);
  };
  if (!scene.compiled_object) {
    scene.compiled_object =
        scene.object_key.empty() ? build() : parts.get<Object>(scene.object_key, stop, build);
  }
  if (alone) sizes = {ObjectSize(*scene.compiled_object)};
  check_sizes(scene, sizes);
  check_corner_normals(scene);
  return std::make_unique<const Scene::Compiled>(std::move(scene), parts, stop);
}

}  // namespace

size_t memory_of(const SceneDescription& description) {
  size_t sum = size_of(description.object) +
               description.corner_normals.size() * sizeof(std::array<Vec3f, 3>);
  for (const OtherObject& other : description.other_objects) sum += size_of(other.mesh);
  for (const DiffuseSurface& surface : description.surfaces) {
    sum += size_of(surface.mesh) + memory_of(surface.reflectance);
  }
  for (const LightDescription& light : description.lights) {
    const auto* map = std::get_if<EnvironmentMapLight>(&light);
    sum += sizeof(light) + (map ? map->rgb.size() * sizeof(float) : 0);
  }
  return sum;
}

size_t estimated_memory(const SceneDescription& description) {
  constexpr size_t kByTriangleInEmbree = 250;  // and while its tree is built
  constexpr size_t kByTriangleInChecks = 200;  // edges, parts
  const auto& compiled = description.compiled_object;
  size_t triangles = (compiled ? compiled->mesh : description.object).triangles.size();
  size_t sum = 0;
  bool smooth = description.smooth_angle > 0 || !description.corner_normals.empty();
  for (const OtherObject& other : description.other_objects) {
    sum += size_of(other.mesh);
    triangles += other.mesh.triangles.size();
    smooth = smooth || other.smooth_angle > 0;
  }
  if (!compiled || !description.other_objects.empty()) {
    sum += Grid::most_memory(triangles) + DepthGrid::most_memory() +
           (kByTriangleInEmbree + kByTriangleInChecks) * triangles;
  }
  if (smooth) {
    constexpr size_t kByTriangleInNormals = 120;  // of corners, and while they are computed
    sum += kByTriangleInNormals * triangles;
  }
  if (refracts(description.boundary)) {
    sum += CellNormals::most_memory();
    if (is_nearly_smooth(description.boundary)) sum += Facets::most_memory(triangles);
  }
  for (const DiffuseSurface& surface : description.surfaces) {
    constexpr size_t kCopies = 3;  // of the compiled scene, of both tracers
    sum += kCopies * size_of(surface.mesh) +
           (Surfaces::kBytesByTriangle + 2 * kByTriangleInEmbree) * surface.mesh.triangles.size();
    // All channels are counted, and again one by one: more than what is compiled.
    sum += 2 * memory_of(surface.reflectance);
  }
  for (const LightDescription& light : description.lights) {
    constexpr size_t kTables = size_t{4} << 20;  // of skies and maps
    constexpr size_t kByPixel = 64;  // of luminance, of each colour, and while it is built
    const auto* map = std::get_if<EnvironmentMapLight>(&light);
    if (map != nullptr || std::holds_alternative<SunSkyLight>(light)) sum += kTables;
    sum += sizeof(light) + (map ? kByPixel * map->rgb.size() / 3 : 0);
  }
  constexpr size_t kByFilmPixel = sizeof(uint32_t) + 1;  // which of them see the object
  return sum + kByFilmPixel * static_cast<size_t>(description.film.width) *
                   static_cast<size_t>(description.film.height);
}

Scene::Scene(SceneDescription description, const std::stop_token& stop)
    : own_parts_(std::make_unique<PartCache>(std::numeric_limits<size_t>::max())),
      compiled_(compile(std::move(description), *own_parts_, stop)) {}
Scene::Scene(SceneDescription description, PartCache& parts, const std::stop_token& stop)
    : compiled_(compile(std::move(description), parts, stop)) {}
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
  return sizeof(*this) + compiled_->memory() + (own_parts_ ? own_parts_->memory() : 0);
}
const std::vector<std::string>& Scene::part_keys() const {
  return compiled_->part_keys;
}

}  // namespace itn::tracer
