#include "server/tracer/scene/compiled_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "common/error.h"
#include "server/tracer/scene/object_pixels.h"

namespace itn::tracer {
namespace {

using OtherMedium = Scene::Compiled::OtherMedium;

Bounds enlarged(const Bounds& box) {
  const float margin = 1e-3F * length(box.max - box.min);
  const Vec3f by{margin, margin, margin};
  return {box.min - by, box.max + by};
}

bool contains(const Bounds& box, Vec3d p) {
  const auto low = static_cast<Vec3d>(box.min), high = static_cast<Vec3d>(box.max);
  return p.x >= low.x && p.y >= low.y && p.z >= low.z && p.x <= high.x && p.y <= high.y &&
         p.z <= high.z;
}

Reflectance compile(const Reflectance& reflectance, const Pose& pose, Channel channel) {
  return std::visit([&](const auto& kind) -> Reflectance { return kind.compile(pose, channel); },
                    reflectance);
}

std::vector<DiffuseSurface> to_object(const Pose& pose, Channel channel,
                                      std::vector<DiffuseSurface> surfaces) {
  for (DiffuseSurface& surface : surfaces) {
    surface.mesh = to_object(pose, std::move(surface.mesh));
    surface.reflectance = compile(surface.reflectance, pose, channel);
  }
  return surfaces;
}

std::vector<std::vector<Reflectance>> colour_reflectances_of(const SceneDescription& scene) {
  std::vector<std::vector<Reflectance>> by_colour;
  if (scene.film.channel != Channel::kRgb) return by_colour;
  for (const Channel colour : kColours) {
    auto& reflectances = by_colour.emplace_back();
    for (const DiffuseSurface& surface : scene.surfaces) {
      reflectances.push_back(compile(surface.reflectance, scene.pose, colour));
    }
  }
  return by_colour;
}

CameraDescription to_object(const Pose& pose, const CameraDescription& camera) {
  CameraDescription turned = camera;
  turned.origin = pose.to_object(camera.origin);
  turned.target = pose.to_object(camera.target);
  turned.up = pose.rotation.inverse()(camera.up);
  return turned;
}

// Shared by the scenes of an object that share that.
template <typename Detail, typename Build>
std::shared_ptr<const Detail> shared_detail(const SceneDescription& scene, std::string key,
                                            PartCache& parts, std::vector<std::string>& part_keys,
                                            const std::stop_token& stop, const Build& build) {
  const auto compute = [&] { return std::make_shared<const Detail>(build()); };
  if (scene.object_key.empty()) return compute();
  part_keys.push_back(std::move(key) + scene.object_key);
  return parts.get<Detail>(part_keys.back(), stop, compute);
}

BoundaryDetails boundary_details(const SceneDescription& scene, const Object& object,
                                 const std::vector<OtherMedium>& others, PartCache& parts,
                                 std::vector<std::string>& part_keys, const std::stop_token& stop) {
  BoundaryDetails details;
  const auto is_smooth = [](const OtherObject& other) { return other.smooth_angle > 0; };
  const bool given = !scene.corner_normals.empty();
  if (stops_lines(scene.boundary) &&
      (given || scene.smooth_angle > 0 || std::ranges::any_of(scene.other_objects, is_smooth))) {
    details.corners = shared_detail<CornerNormals>(
        scene, part_key("corner normals", scene.smooth_angle), parts, part_keys, stop, [&] {
          std::vector<CornerNormals::Range> ranges{{0, scene.smooth_angle}};
          for (size_t k = 0; k < others.size(); ++k) {
            ranges.push_back({others[k].first_triangle, scene.other_objects[k].smooth_angle});
          }
          return CornerNormals(object.mesh, ranges, stop);
        });
    if (given) {
      details.corners =
          std::make_shared<const CornerNormals>(details.corners->with(scene.corner_normals));
    }
  }
  if (refracts(scene.boundary)) {
    details.cells = shared_detail<CellNormals>(scene, "cell normals", parts, part_keys, stop, [&] {
      return CellNormals(object.mesh, object.depth_grid, stop);
    });
  }
  if (is_nearly_smooth(scene.boundary)) {
    details.facets = shared_detail<Facets>(scene, "facets", parts, part_keys, stop,
                                           [&] { return Facets(object.mesh, stop); });
  }
  return details;
}

// Their triangles are the last ones of the mesh.
std::vector<OtherMedium> other_media_of(const SceneDescription& scene, const Object& object) {
  size_t triangles = object.mesh.triangles.size();
  for (const OtherObject& other : scene.other_objects) triangles -= other.mesh.triangles.size();
  auto first = static_cast<uint32_t>(triangles);
  std::vector<OtherMedium> media;
  for (const OtherObject& other : scene.other_objects) {
    media.push_back({first, other.material, compile(other.boundary)});
    first += static_cast<uint32_t>(other.mesh.triangles.size());
  }
  return media;
}

// The medium that a point inside of one is in.
size_t medium_around(const SceneDescription& scene, Vec3d p) {
  for (size_t k = 0; k < scene.other_objects.size(); ++k) {
    if (winding_number(scene.other_objects[k].mesh, p) > 0.5) return k + 1;
  }
  return 0;
}

// The key of what lines meet. It is unlike any other if it is not said what that depends on.
std::string geometry_key(const SceneDescription& scene, bool has_surfaces) {
  static std::atomic<uint64_t> others = 0;
  if (scene.object_key.empty() || (scene.surfaces_digest.empty() && has_surfaces)) {
    return part_key("a geometry", ++others);
  }
  return part_key("geometry", scene.pose, scene.object_key.size()) + scene.object_key +
         scene.surfaces_digest;
}

// The key of the lamps that lines meet.
std::string lamps_key(const Lights& lights) {
  std::string key;
  for (const Lights::Light& light : lights.all()) {
    std::visit(
        [&]<typename Kind>(const Kind& kind) {
          if constexpr (VisibleLamp<Kind>) key += part_key(Kind::kName, kind);
        },
        light.kind);
  }
  return key;
}

// A lamp sends its radiance into air: what of it is in a medium of another index has no meaning.
void check_lamps(const Lights& lights, const Object& object, const Boundary& boundary,
                 const std::vector<OtherMedium>& others) {
  const auto bends = [](const Boundary& at) { return relative_index(at) != 1; };
  if (!bends(boundary) && std::ranges::none_of(others, bends, &OtherMedium::boundary)) return;
  for (const Lights::Light& light : lights.all()) {
    std::visit(
        [&]<typename Kind>(const Kind& kind) {
          if constexpr (VisibleLamp<Kind>) {
            if (!kind.cuts(object.mesh, object.bounds)) return;
            throw invalid_input(
                fmt::format("lights[{}].{} is partly inside of an object that refracts light; a "
                            "lamp must stand outside of it, and may touch it",
                            light.number, Kind::kName));
          }
        },
        light.kind);
  }
}

}  // namespace

Scene::Compiled::Compiled(SceneDescription&& scene, PartCache& parts, const std::stop_token& stop)
    : object(std::move(scene.compiled_object)),
      boundary(tracer::compile(scene.boundary)),
      other_media(other_media_of(scene, *object)),
      colour_reflectances(colour_reflectances_of(scene)),
      surfaces(to_object(scene.pose, scene.film.channel, std::move(scene.surfaces))),
      obstacles(object, surfaces,
                boundary_details(scene, *object, other_media, parts, part_keys, stop)),
      lights(scene.lights, {scene.film.channel, scene.pose, object->mesh, parts, part_keys},
             scene.light_colours),
      camera(to_object(scene.pose, scene.camera), scene.film),
      film(scene.film),
      camera_inside(contains(object->bounds, camera.origin()) &&
                    winding_number(object->mesh, camera.origin()) > 0.5),
      camera_medium(camera_inside ? medium_around(scene, camera.origin()) : 0),
      camera_weight(camera_inside ? static_cast<float>(
                                        std::pow(relative_index(boundary_of(camera_medium)), 2))
                                  : 1),
      camera_score(camera_inside && camera_medium == 0
                       ? static_cast<float>(2 / relative_index(boundary))
                       : 0),
      box(enlarged(obstacles.bounds)),
      film_box(camera.film_box(static_cast<Vec3d>(box.min), static_cast<Vec3d>(box.max))),
      parts_(parts),
      object_is_shared_(!scene.object_key.empty()),
      geometry_key_(geometry_key(scene, !surfaces.empty())),
      object_pixels_key_(part_key("pixels", scene.camera, film.width, film.height) +
                         lamps_key(lights) + geometry_key_) {
  check_lamps(lights, *object, boundary, other_media);
  part_keys.insert(part_keys.end(), {scene.object_key, geometry_key_, object_pixels_key_});
}

CameraRay Scene::Compiled::camera_ray(double x, double y) const {
  const Vec3d origin = camera.origin(), toward = camera.toward(x, y);
  const auto direction = static_cast<Vec3f>(itn::normalize(toward));
  const bool at_box =
      !camera_inside && film_box.depth > 0 && film_box.contains(x, y) &&
      !obstacles.surfaces.in_front(origin, toward, film_box.depth) &&
      !(lights.reach(static_cast<Vec3f>(origin), direction) <= film_box.depth * length(toward));
  return {static_cast<Vec3f>(at_box ? origin + toward * film_box.depth : origin), direction};
}

const Geometry& Scene::Compiled::geometry() const {
  const std::lock_guard lock(mutex_);
  if (!geometry_) {
    geometry_ = parts_.get<Geometry>(geometry_key_, {}, [&] {
      return std::make_shared<const Geometry>(object->mesh, surfaces);
    });
  }
  return *geometry_;
}

const std::vector<uint32_t>& Scene::Compiled::object_pixels(int threads,
                                                            const std::stop_token& stop) const {
  {
    const std::lock_guard lock(mutex_);
    if (object_pixels_) return object_pixels_->pixels;
  }
  const auto found = parts_.get<ObjectPixels>(object_pixels_key_, stop, [&] {
    return std::make_shared<const ObjectPixels>(*this, threads, stop);
  });
  const std::lock_guard lock(mutex_);
  if (!object_pixels_) object_pixels_ = found;
  return object_pixels_->pixels;
}

size_t Scene::Compiled::memory() const {
  size_t sum = sizeof(*this) + obstacles.surfaces.memory();
  if (!object_is_shared_) {
    sum += object->memory() + obstacles.corner_normals.memory() + obstacles.cell_normals.memory() +
           obstacles.facets.memory();
  }
  for (const std::string& key : part_keys) sum += sizeof(std::string) + key.size();
  for (const DiffuseSurface& surface : surfaces) {
    sum += surface.mesh.vertices.size() * sizeof(Vec3f) +
           surface.mesh.triangles.size() * sizeof(std::array<uint32_t, 3>);
    sum += memory_of(surface.reflectance);
  }
  for (const auto& reflectances : colour_reflectances) {
    for (const Reflectance& reflectance : reflectances) sum += memory_of(reflectance);
  }
  return sum;
}

}  // namespace itn::tracer
