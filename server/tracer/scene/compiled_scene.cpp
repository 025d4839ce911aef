#include "server/tracer/scene/compiled_scene.h"

#include <algorithm>

#include "server/tracer/wavefront/wavefront.h"

namespace itn::tracer {
namespace {

Bounds enlarged(const Bounds& box) {
  const float margin = 1e-3F * length(box.max - box.min);
  const Vec3f by{margin, margin, margin};
  return {box.min - by, box.max + by};
}

}  // namespace

Scene::Compiled::Compiled(SceneDescription&& scene)
    : object(std::move(scene.object)),
      surfaces(std::move(scene.surfaces)),
      boundary(object, surfaces),
      lights(scene.lights, scene.film.channel),
      light_tables(lights),
      camera(scene.camera, scene.film),
      film(scene.film),
      camera_inside(winding_number(object, camera.origin()) > 0.5),
      box(enlarged(boundary.bounds)),
      film_box(camera.film_box(static_cast<Vec3d>(box.min), static_cast<Vec3d>(box.max))) {}

CameraRay Scene::Compiled::camera_ray(double x, double y) const {
  const Vec3d origin = camera.origin(), toward = camera.toward(x, y);
  const auto direction = static_cast<Vec3f>(itn::normalize(toward));
  const bool at_box = !camera_inside && film_box.depth > 0 && film_box.contains(x, y) &&
                      !boundary.surfaces.in_front(origin, toward, film_box.depth);
  return {static_cast<Vec3f>(at_box ? origin + toward * film_box.depth : origin), direction};
}

const Geometry& Scene::Compiled::geometry() const {
  std::call_once(geometry_once_, [&] { geometry_ = std::make_unique<Geometry>(object, surfaces); });
  return *geometry_;
}

const std::vector<uint32_t>& Scene::Compiled::object_pixels() const {
  std::call_once(object_pixels_once_, [&] { object_pixels_ = find_object_pixels(); });
  return object_pixels_;
}

std::vector<uint32_t> Scene::Compiled::find_object_pixels() const {
  constexpr uint32_t kRaysPerPixel = kMaskRays * kMaskRays;
  const auto pixels = static_cast<uint32_t>(film.width) * static_cast<uint32_t>(film.height);
  std::vector<bool> sees(pixels, camera_inside);
  const auto rays = std::make_unique<Rays>();
  std::vector<uint32_t> pixel_of_ray;
  const auto follow_all = [&] {
    follow(boundary, *rays, pixel_of_ray.size());
    for (size_t i = 0; i < pixel_of_ray.size(); ++i) {
      if (rays->outcome[i] & Rays::kEntered) {
        sees[pixel_of_ray[i]] = true;
      }
    }
    pixel_of_ray.clear();
  };
  for (uint32_t ray = 0; !camera_inside && ray < pixels * uint64_t{kRaysPerPixel}; ++ray) {
    const uint32_t pixel = ray / kRaysPerPixel, place = ray % kRaysPerPixel;
    const auto width = static_cast<uint32_t>(film.width);
    const double x = pixel % width + (place % kMaskRays + 0.5) / kMaskRays;
    const double y = pixel / width + (place / kMaskRays + 0.5) / kMaskRays;
    if (!film_box.contains(x, y)) {
      continue;
    }
    const CameraRay from = camera_ray(x, y);
    const size_t i = pixel_of_ray.size();
    rays->position.set(i, from.origin);
    rays->direction.set(i, from.direction);
    rays->place[i] = 0;
    rays->budget[i] = 0;
    pixel_of_ray.push_back(pixel);
    if (pixel_of_ray.size() == kSlots) {
      follow_all();
    }
  }
  follow_all();
  std::vector<uint32_t> result;
  for (uint32_t pixel = 0; pixel < pixels; ++pixel) {
    if (sees[pixel]) {
      result.push_back(pixel);
    }
  }
  return result;
}

size_t Scene::Compiled::memory() const {
  const auto of = [](const Mesh& mesh) {
    return mesh.vertices.size() * sizeof(Vec3f) +
           mesh.triangles.size() * sizeof(std::array<uint32_t, 3>);
  };
  size_t sum = sizeof(*this) + of(object) + boundary.memory() + lights.memory();
  for (const DiffuseSurface& surface : surfaces) {
    sum += of(surface.mesh);
  }
  return sum;
}

}  // namespace itn::tracer
