#include "server/tracer/scene/object.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace itn::tracer {
namespace {

float largest_coordinate(const Bounds& box) {
  const auto reach = [](float a, float b) { return std::max(std::abs(a), std::abs(b)); };
  return std::max(
      {reach(box.min.x, box.max.x), reach(box.min.y, box.max.y), reach(box.min.z, box.max.z)});
}

}  // namespace

Object::Object(Mesh closed, const std::stop_token& stop)
    : mesh(std::move(closed)),
      bounds(itn::bounds(mesh)),
      extent(largest_coordinate(bounds)),
      grid(mesh, stop),
      depths(mesh, stop) {}

size_t Object::memory() const {
  return sizeof(*this) + mesh.vertices.size() * sizeof(Vec3f) +
         mesh.triangles.size() * sizeof(std::array<uint32_t, 3>) + grid.memory() + depths.memory();
}

std::shared_ptr<const Object> compile_object(Mesh mesh, const std::string& what,
                                             const std::stop_token& stop) {
  validate_triangles(mesh, what);
  validate_closed(mesh, what, stop);
  return std::make_shared<const Object>(std::move(mesh), stop);
}

}  // namespace itn::tracer
