#include "server/tracer/wavefront/surfaces.h"

#include <algorithm>
#include <limits>

namespace itn::tracer {

Surfaces::Surfaces(const std::vector<DiffuseSurface>& surfaces) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  bounds = {{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
  std::vector<Mesh> meshes;
  for (const DiffuseSurface& surface : surfaces) {
    first_triangle_of_mesh.push_back(static_cast<uint32_t>(triangles));
    meshes.push_back(surface.mesh);
    for (const auto& triangle : surface.mesh.triangles) {
      Vec3d corner[3];
      for (size_t k = 0; k < 3; ++k) {
        const Vec3f v = surface.mesh.vertices[triangle[k]];
        corners[k].push_back(v);
        corner[k] = static_cast<Vec3d>(v);
        bounds.min = {std::min(bounds.min.x, v.x), std::min(bounds.min.y, v.y),
                      std::min(bounds.min.z, v.z)};
        bounds.max = {std::max(bounds.max.x, v.x), std::max(bounds.max.y, v.y),
                      std::max(bounds.max.z, v.z)};
      }
      normals.push_back(static_cast<Vec3f>(
          itn::normalize(cross(corner[1] - corner[0], corner[2] - corner[0]))));
      reflectances.push_back(surface.reflectance);
      ++triangles;
    }
  }
  for (Vectors* vectors : {&corners[0], &corners[1], &corners[2], &normals}) {
    vectors->push_back({});
  }
  reflectances.push_back(0);
  if (triangles > kFew) {
    many = make_embree_intersector({}, meshes);
  }
}

size_t Surfaces::memory() const {
  return sizeof(*this) + reflectances.size() * 13 * sizeof(float) + (many ? many->memory() : 0);
}

}  // namespace itn::tracer
