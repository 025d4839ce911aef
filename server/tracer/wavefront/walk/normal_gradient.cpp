#include "server/tracer/wavefront/walk/normal_gradient.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/geometry/mesh.h"
#include "server/tracer/wavefront/walk/paths.h"

namespace itn::tracer {
namespace {

// Of a point in a triangle's plane.
std::array<double, 3> barycentric(const Mesh& mesh, uint32_t triangle, Vec3d p) {
  const auto corner = [&](size_t k) {
    return static_cast<Vec3d>(mesh.vertices[mesh.triangles[triangle][k]]);
  };
  const Vec3d a = corner(0), to_b = corner(1) - a, to_c = corner(2) - a, to_p = p - a;
  const Vec3d n = cross(to_b, to_c);
  const double v = std::clamp(dot(cross(to_p, to_c), n) / dot(n, n), 0.0, 1.0);
  const double w = std::clamp(dot(cross(to_b, to_p), n) / dot(n, n), 0.0, 1.0);
  return {1 - v - w, v, w};
}

}  // namespace

void NormalGradient::add(uint32_t pixel, uint32_t sample, const NormalScore& at, double light) {
  const Mesh& mesh = scene_.object->mesh;
  const CornerNormals& normals = scene_.obstacles.corner_normals;
  const std::array<double, 3> parts = barycentric(mesh, at.triangle, static_cast<Vec3d>(at.place));
  Vec3d sum;
  if (normals.flat()) {
    const auto corner = [&](size_t k) {
      return static_cast<Vec3d>(mesh.vertices[mesh.triangles[at.triangle][k]]);
    };
    sum = normalize(cross(corner(1) - corner(0), corner(2) - corner(0)));
  } else {
    for (size_t k = 0; k < 3; ++k) {
      sum = sum + static_cast<Vec3d>(normals.by_triangle()[at.triangle][k]) * parts[k];
    }
  }
  const double size = length(sum);
  if (size * size <= double{CornerNormals::kLeastSquare}) return;
  const Vec3d normal = sum * (1 / size), score = static_cast<Vec3d>(at.score);
  const Vec3d across = (score - normal * dot(normal, score)) * (light / size);
  film_.add_to_normals(pixel, sample, at.triangle,
                       {across * parts[0], across * parts[1], across * parts[2]});
}

void NormalGradient::record(const Paths& paths, size_t slot) {
  if (paths.leaked[slot] != 0) return;
  for (const BoundaryTurn& turn : paths.turns[slot]) {
    const double light = turn.edge ? double{paths.edge_radiance[0][slot]}
                                   : double{paths.radiance[slot]} - double{turn.radiance};
    if (light != 0) add(paths.pixel[slot], paths.sample[slot], turn.normal, light);
  }
}

}  // namespace itn::tracer
