#include "server/tracer/collected/normal_gradient.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/geometry/mesh.h"

namespace itn::tracer {
void NormalGradient::add(uint32_t pixel, uint32_t sample, const NormalScore& scored, double light) {
  const Mesh& mesh = scene_.object->mesh;
  const auto corner = [&](size_t k) {
    return static_cast<Vec3d>(mesh.vertices[mesh.triangles[scored.triangle][k]]);
  };
  const Vec3d a = corner(0), to_b = corner(1) - a, to_c = corner(2) - a;
  const Vec3d n = cross(to_b, to_c), to_p = static_cast<Vec3d>(scored.place) - a;
  const auto part = [&](Vec3d area) { return std::clamp(dot(area, n) / dot(n, n), 0.0, 1.0); };
  const double v = part(cross(to_p, to_c)), w = part(cross(to_b, to_p));
  const std::array<double, 3> parts{1 - v - w, v, w};
  const CornerNormals& normals = scene_.obstacles.corner_normals;
  Vec3d sum = n * (1 / length(n));
  if (!normals.flat()) {
    sum = {};
    for (size_t k = 0; k < 3; ++k) {
      sum = sum + static_cast<Vec3d>(normals.by_triangle()[scored.triangle][k]) * parts[k];
    }
  }
  const double size = length(sum);
  if (size * size <= double{CornerNormals::kLeastSquare}) return;
  const Vec3d normal = sum * (1 / size), score = static_cast<Vec3d>(scored.score);
  const Vec3d across = (score - normal * dot(normal, score)) * (light / size);
  film_.add_to_normals(pixel, sample, scored.triangle,
                       {across * parts[0], across * parts[1], across * parts[2]});
}

void NormalGradient::note_radiance(const FloatColumn& radiance) {
  for (const size_t slot : turned_) turns_[slot].back().radiance = radiance[slot];
  turned_.clear();
}

void NormalGradient::add_to_film(uint32_t pixel, uint32_t sample, size_t slot, float radiance) {
  for (const BoundaryTurn& turn : turns_[slot]) {
    const double light =
        turn.edge ? double{edge_radiance_[slot]} : double{radiance} - double{turn.radiance};
    if (light != 0) add(pixel, sample, turn.normal, light);
  }
}

}  // namespace itn::tracer
