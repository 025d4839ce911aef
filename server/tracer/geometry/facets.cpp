#include "server/tracer/geometry/facets.h"

#include <algorithm>
#include <array>

#include "common/cancellation.h"
#include "server/tracer/geometry/corner_normals.h"
#include "server/tracer/geometry/fans.h"

namespace itn::tracer {
namespace {

Facets::Facet facet_of(const Mesh& mesh, uint32_t triangle) {
  const auto& [a, b, c] = mesh.triangles[triangle];
  const auto corner = static_cast<Vec3d>(mesh.vertices[a]);
  const Vec3d to_b = static_cast<Vec3d>(mesh.vertices[b]) - corner;
  const Vec3d to_c = static_cast<Vec3d>(mesh.vertices[c]) - corner;
  const Vec3d n = cross(to_b, to_c);
  const double n2 = dot(n, n);
  const double per_n2 = n2 > 0 ? 1 / n2 : 0;
  return {mesh.vertices[a], static_cast<Vec3f>(n2 > 0 ? itn::normalize(n) : n),
          static_cast<Vec3f>(cross(to_c, n) * per_n2), static_cast<Vec3f>(cross(n, to_b) * per_n2)};
}

}  // namespace

Facets::Facets(const Mesh& mesh, const std::stop_token& stop) {
  Cancellation cancellation(stop);
  const Fans fans(mesh);
  std::vector<uint32_t> near;  // as often as a vertex is shared
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    cancellation.turn();
    by_triangle.push_back(facet_of(mesh, t));
    first.push_back(static_cast<uint32_t>(around.size()));
    around.push_back(t);
    near.clear();
    for (const uint32_t vertex : mesh.triangles[t]) {
      // Facets around the point of a cone are too many to be neighbours.
      if (fans.first[vertex + 1] - fans.first[vertex] > CornerNormals::kMaxFan) continue;
      near.insert(near.end(), fans.triangles.begin() + fans.first[vertex],
                  fans.triangles.begin() + fans.first[vertex + 1]);
    }
    std::ranges::sort(near);
    for (const std::ptrdiff_t shared : {2, 1}) {
      for (auto same = near.begin(); same != near.end();) {
        const auto end = std::find_if(same, near.end(), [&](uint32_t o) { return o != *same; });
        const bool wanted = *same != t && (shared == 2 ? end - same >= 2 : end - same == 1);
        if (wanted && around.size() - first.back() < kMost) around.push_back(*same);
        same = end;
      }
    }
  }
  first.push_back(static_cast<uint32_t>(around.size()));
}

}  // namespace itn::tracer
