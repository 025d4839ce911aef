#include "server/tracer/geometry/object.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "common/error.h"

namespace itn::tracer {
namespace {

float largest_coordinate(const Bounds& box) {
  const auto reach = [](float a, float b) { return std::max(std::abs(a), std::abs(b)); };
  return std::max(
      {reach(box.min.x, box.max.x), reach(box.min.y, box.max.y), reach(box.min.z, box.max.z)});
}

void check_length(const Mesh& mesh, const std::string& what) {
  const Bounds box = bounds(mesh);
  const double least = std::max(kSmallestLength, kSmallestPart * double{largest_coordinate(box)});
  if (!(static_cast<float>(longest_side(box)) >= static_cast<float>(least))) {
    throw invalid_input(fmt::format(
        "{}: its longest side is {:g} mm; it must be {:g} mm at least, and {:g} of its "
        "largest coordinate, which is {:g} mm",
        what, longest_side(box), kSmallestLength, kSmallestPart, largest_coordinate(box)));
  }
}

}  // namespace

Object::Object(Mesh closed, const std::stop_token& stop)
    : mesh(std::move(closed)),
      bounds(itn::bounds(mesh)),
      extent(largest_coordinate(bounds)),
      length(longest_side(bounds)),
      thickness(itn::thickness(mesh)),
      grid(mesh, stop),
      depth_grid(mesh, stop) {}

size_t Object::memory() const {
  return sizeof(*this) + mesh.vertices.size() * sizeof(Vec3f) +
         mesh.triangles.size() * sizeof(std::array<uint32_t, 3>) + grid.memory() +
         depth_grid.memory();
}

std::shared_ptr<const Object> compile_object(Mesh mesh, const std::string& what,
                                             const std::stop_token& stop) {
  validate_triangles(mesh, what);
  check_length(mesh, what);
  validate_closed(mesh, what, stop);
  return std::make_shared<const Object>(std::move(mesh), stop);
}

}  // namespace itn::tracer
