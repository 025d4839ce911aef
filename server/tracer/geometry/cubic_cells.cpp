#include "server/tracer/geometry/cubic_cells.h"

namespace itn::tracer {

// The sum of a convex body and a box of edges h has the volume of the body, plus h times the areas
// of its projections along the axes, plus h^2 times its extents along them, plus h^3; in cells, the
// same over h^3.
ExpectedTouches::ExpectedTouches(const Mesh& mesh, Cancellation& cancellation)
    : triangles_(static_cast<double>(mesh.triangles.size())) {
  for (const auto& triangle : mesh.triangles) {
    cancellation.turn();
    const auto corner = [&](size_t k) { return static_cast<Vec3d>(mesh.vertices[triangle[k]]); };
    const Vec3d a = corner(0), b = corner(1), c = corner(2), normal = cross(b - a, c - a);
    const auto extent = [](double p, double q, double r) {
      return std::max({p, q, r}) - std::min({p, q, r});
    };
    widths_ += extent(a.x, b.x, c.x) + extent(a.y, b.y, c.y) + extent(a.z, b.z, c.z);
    areas_ += (std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z)) / 2;
  }
}

}  // namespace itn::tracer
