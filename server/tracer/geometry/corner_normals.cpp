#include "server/tracer/geometry/corner_normals.h"

#include <algorithm>
#include <cmath>

#include "common/cancellation.h"
#include "server/tracer/geometry/fans.h"

namespace itn::tracer {
CornerNormals::CornerNormals(const Mesh& mesh, const std::vector<Range>& ranges,
                             const std::stop_token& stop) {
  Cancellation cancellation(stop);
  const auto corner = [&](uint32_t triangle, size_t k) {
    return static_cast<Vec3d>(mesh.vertices[mesh.triangles[triangle][k % 3]]);
  };
  const auto triangles = static_cast<uint32_t>(mesh.triangles.size());
  std::vector<Vec3d> normals(triangles);
  std::vector<std::array<double, 3>> angles(triangles);
  for (uint32_t t = 0; t < triangles; ++t) {
    cancellation.turn();
    normals[t] = itn::normalize(cross(corner(t, 1) - corner(t, 0), corner(t, 2) - corner(t, 0)));
    for (size_t k = 0; k < 3; ++k) {
      const Vec3d a = corner(t, k + 1) - corner(t, k), b = corner(t, k + 2) - corner(t, k);
      angles[t][k] = std::atan2(length(cross(a, b)), dot(a, b));
    }
  }
  double least = 1;
  auto next = ranges.begin();
  const Fans fans(mesh);
  by_triangle_.resize(triangles);
  for (uint32_t t = 0; t < triangles; ++t) {
    cancellation.turn();
    for (; next != ranges.end() && next->first <= t; ++next) least = std::cos(next->smooth_angle);
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t vertex = mesh.triangles[t][k];
      Vec3d sum = normals[t] * angles[t][k];
      const bool small = fans.first[vertex + 1] - fans.first[vertex] <= kMaxFan;
      for (uint32_t f = fans.first[vertex]; small && f < fans.first[vertex + 1]; ++f) {
        const uint32_t other = fans.triangles[f];
        if (other == t || !(dot(normals[other], normals[t]) >= least)) continue;
        const auto& corners = mesh.triangles[other];
        const auto place = std::ranges::find(corners, vertex) - corners.begin();
        sum = sum + normals[other] * angles[other][static_cast<size_t>(place)];
      }
      by_triangle_[t][k] = static_cast<Vec3f>(itn::normalize(sum));
    }
  }
}

}  // namespace itn::tracer
