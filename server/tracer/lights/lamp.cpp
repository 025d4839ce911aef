#include "server/tracer/lights/lamp.h"

#include <fmt/format.h>

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "common/error.h"
#include "common/geometry/mesh.h"

namespace itn::tracer {

LampPlace lamp_place(const LightFrame& frame, const std::string& field, Vec3d position) {
  const Vec3d p = frame.pose.to_object(position);
  const Bounds box = frame.object.vertices.empty() ? Bounds() : bounds(frame.object);
  const auto low = static_cast<Vec3d>(box.min), high = static_cast<Vec3d>(box.max);
  const Vec3d to_middle = (low + high) * 0.5 - p, to_corner = (high - low) * 0.5;
  const bool in_box = std::abs(to_middle.x) <= to_corner.x &&
                      std::abs(to_middle.y) <= to_corner.y && std::abs(to_middle.z) <= to_corner.z;
  constexpr double kInside = 0.75;  // and half on a face, which may touch
  if (in_box && winding_number(frame.object, p) > kInside) {
    throw invalid_input(
        fmt::format("{} is ({}, {}, {}), in the object; a lamp must stand outside of it", field,
                    position.x, position.y, position.z));
  }
  const double reach = std::max({length(low), length(high), length(p)});
  return {p, std::max(dot(to_middle, to_middle), dot(to_corner, to_corner)),
          8 * double{FLT_EPSILON} * reach};
}

}  // namespace itn::tracer
