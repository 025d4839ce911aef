#include "server/tracer/geometry/surface_triangles.h"

#include <algorithm>
#include <limits>

#include "server/tracer/geometry/corner_normals.h"

namespace itn::tracer {

Surfaces::Surfaces(const std::vector<DiffuseSurface>& surfaces) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  bounds = {{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
  std::vector<Mesh> meshes;
  for (const DiffuseSurface& surface : surfaces) {
    first_triangle_of_mesh.push_back(static_cast<uint32_t>(triangles));
    meshes.push_back(surface.mesh);
    const auto* uniform = std::get_if<UniformReflectance>(&surface.reflectance);
    if (uniform == nullptr) {
      const auto count = static_cast<uint32_t>(surface.mesh.triangles.size());
      const uint32_t first = first_triangle_of_mesh.back();
      patterned.push_back(
          {{first, first + count}, surface.reflectance, first_triangle_of_mesh.size() - 1});
    }
    for (const auto& triangle : surface.mesh.triangles) {
      Vec3f corner[3];
      for (size_t k = 0; k < 3; ++k) corner[k] = surface.mesh.vertices[triangle[k]];
      const auto exact = [&](size_t k) { return static_cast<Vec3d>(corner[k]); };
      const Vec3d normal = cross(exact(1) - exact(0), exact(2) - exact(0));
      // A triangle without an area is met nowhere, as comparisons with NaN are false.
      const bool is_empty = !(length(normal) > 0);
      for (size_t k = 0; k < 3; ++k) {
        const Vec3f v = corner[k];
        corners[k].push_back(is_empty ? Vec3f{kNan, kNan, kNan} : v);
        bounds.min = {std::min(bounds.min.x, v.x), std::min(bounds.min.y, v.y),
                      std::min(bounds.min.z, v.z)};
        bounds.max = {std::max(bounds.max.x, v.x), std::max(bounds.max.y, v.y),
                      std::max(bounds.max.z, v.z)};
      }
      normals.push_back(is_empty ? Vec3f{0, 1, 0} : static_cast<Vec3f>(itn::normalize(normal)));
      reflectances.push_back(uniform == nullptr ? 0 : uniform->value);
      ++triangles;
    }
  }
  for (Vectors* vectors : {&corners[0], &corners[1], &corners[2], &normals}) vectors->push_back({});
  add_corner_normals(surfaces);
  reflectances.push_back(0);
  if (triangles > kFew) many = make_embree_intersector({}, meshes);
}

void Surfaces::add_corner_normals(const std::vector<DiffuseSurface>& surfaces) {
  const auto is_smooth = [](const DiffuseSurface& surface) { return surface.smooth_angle > 0; };
  if (std::ranges::none_of(surfaces, is_smooth)) return;
  size_t number = 0;
  for (const DiffuseSurface& surface : surfaces) {
    const CornerNormals of_mesh = is_smooth(surface)
                                      ? CornerNormals(surface.mesh, {{0, surface.smooth_angle}})
                                      : CornerNormals();
    for (uint32_t t = 0; t < surface.mesh.triangles.size(); ++t) {
      const Vec3f own = normals.at(number++);
      corner_normals[0].push_back(of_mesh.at(t, 0, 0, own));
      corner_normals[1].push_back(of_mesh.at(t, 1, 0, own));
      corner_normals[2].push_back(of_mesh.at(t, 0, 1, own));
    }
  }
  for (Vectors& vectors : corner_normals) vectors.push_back({});
}

bool Surfaces::in_front(Vec3d origin, Vec3d direction, double length) const {
  const Vec3d end = origin + direction * length;
  const auto apart = [](double a, double b, float low, float high) {
    return std::max(a, b) < double{low} || std::min(a, b) > double{high};
  };
  if (empty() || apart(origin.x, end.x, bounds.min.x, bounds.max.x) ||
      apart(origin.y, end.y, bounds.min.y, bounds.max.y) ||
      apart(origin.z, end.z, bounds.min.z, bounds.max.z)) {
    return false;
  }
  if (many) {
    // A little further, as distances are rounded: to say yes too often does no harm.
    constexpr double kFurther = 1 + 1e-4;
    Line line(static_cast<Vec3f>(origin), static_cast<Vec3f>(direction), {}, 0);
    line.origin = static_cast<Vec3f>(origin);
    return many->closest(line, 0, static_cast<float>(length * kFurther), Wanted::kSurfaceOnly)
        .found;
  }
  for (size_t i = 0; i < triangles; ++i) {
    const auto corner = [&](size_t k) { return static_cast<Vec3d>(corners[k].at(i)) - origin; };
    const Vec3d a = corner(0), b = corner(1), c = corner(2), n = cross(b - a, c - a);
    const double slope = dot(n, direction), t = dot(n, a) / slope;
    const auto same_side = [&](Vec3d p, Vec3d q) {
      return dot(direction, cross(p, q)) * slope >= 0;
    };
    if (slope != 0 && t >= 0 && t <= length && same_side(a, b) && same_side(b, c) &&
        same_side(c, a)) {
      return true;
    }
  }
  return false;
}

size_t Surfaces::memory() const {
  const size_t flat_bytes = kBytesByTriangle - 9 * sizeof(float);  // without normals at corners
  return sizeof(*this) + reflectances.size() * (smooth() ? kBytesByTriangle : flat_bytes) +
         (many ? many->memory() : 0);
}

}  // namespace itn::tracer
