#include "server/tracer/lights/lamp.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>

#include "common/error.h"
#include "common/geometry/mesh.h"

namespace itn::tracer {
namespace {

using Triangle = std::array<Vec3d, 3>;

// What rounding does to places of that size, as a part of it.
constexpr double kRounding = 8 * double{FLT_EPSILON};

Triangle triangle_of(const Mesh& mesh, const std::array<uint32_t, 3>& corners) {
  return {static_cast<Vec3d>(mesh.vertices[corners[0]]),
          static_cast<Vec3d>(mesh.vertices[corners[1]]),
          static_cast<Vec3d>(mesh.vertices[corners[2]])};
}

double squared(Vec3d v) {
  return dot(v, v);
}

// The squared distance of the nearest point of the triangle, which is within it or on one of its
// sides.
double squared_distance(const Triangle& triangle, Vec3d p) {
  const Vec3d normal = cross(triangle[1] - triangle[0], triangle[2] - triangle[0]);
  double nearest = HUGE_VAL;
  bool above = true;  // the point, seen along the normal, of all sides
  for (size_t k = 0; k < 3; ++k) {
    const Vec3d side = triangle[(k + 1) % 3] - triangle[k], to_p = p - triangle[k];
    const double part = std::clamp(dot(to_p, side) / squared(side), 0.0, 1.0);
    nearest = std::min(nearest, squared(to_p - side * part));
    above = above && dot(cross(normal, side), to_p) >= 0;
  }
  const double height = dot(normal, p - triangle[0]);
  return above ? std::min(nearest, height * height / squared(normal)) : nearest;
}

// Whether a line between two points of the plane, whose coordinates these are, has a part inside of
// [-half, half] x [-half, half] (Liang and Barsky 1984).
bool meets_square(double half, std::array<double, 2> from, std::array<double, 2> to) {
  double begin = 0, end = 1;
  for (size_t k = 0; k < 2; ++k) {
    const double along = to[k] - from[k];
    if (along == 0) {
      if (!(std::abs(from[k]) < half)) return false;
      continue;
    }
    const double a = (-half - from[k]) / along, b = (half - from[k]) / along;
    begin = std::max(begin, std::min(a, b));
    end = std::min(end, std::max(a, b));
  }
  return begin < end;
}

// Whether a lamp is so far from the bounds that no triangle is to be looked at: all of it lies
// within `reach` of its center along each axis.
bool is_away(const Bounds& box, Vec3d center, Vec3d reach) {
  const auto low = static_cast<Vec3d>(box.min), high = static_cast<Vec3d>(box.max);
  return center.x + reach.x < low.x || center.x - reach.x > high.x || center.y + reach.y < low.y ||
         center.y - reach.y > high.y || center.z + reach.z < low.z || center.z - reach.z > high.z;
}

}  // namespace

bool is_in_ball(const Mesh& mesh, const Bounds& box, Vec3d center, double radius) {
  if (is_away(box, center, {radius, radius, radius})) return false;
  const double rounding = kRounding * (length(center) + radius);
  const double least = radius - rounding;
  return least > 0 && std::ranges::any_of(mesh.triangles, [&](const auto& corners) {
           return squared_distance(triangle_of(mesh, corners), center) < least * least;
         });
}

bool crosses(const Mesh& mesh, const Bounds& box, Vec3d center, Vec3d half_u, Vec3d half_v) {
  const Vec3d reach_by_axis{std::abs(half_u.x) + std::abs(half_v.x),
                            std::abs(half_u.y) + std::abs(half_v.y),
                            std::abs(half_u.z) + std::abs(half_v.z)};
  if (is_away(box, center, reach_by_axis)) return false;
  const Vec3d n = cross(half_u, half_v), normal = itn::normalize(n);
  const Vec3d across_u = cross(half_v, n) * (1 / dot(n, n)),
              across_v = cross(n, half_u) * (1 / dot(n, n));
  const double reach = length(center) + length(half_u) + length(half_v);
  const double half = 1 - kRounding * reach / std::min(length(half_u), length(half_v));
  return std::ranges::any_of(mesh.triangles, [&](const auto& corners) {
    const Triangle triangle = triangle_of(mesh, corners);
    std::array<double, 3> height;
    double rounding = 0;
    for (size_t k = 0; k < 3; ++k) {
      height[k] = dot(normal, triangle[k] - center);
      rounding =
          std::max(rounding, kRounding * std::min(reach, 2 * length(triangle[k]) + length(center)));
    }
    const auto [low, high] = std::ranges::minmax(height);
    if (!(low < -rounding && high > rounding)) return false;
    // Its line in the plane goes between two of its sides.
    std::array<std::array<double, 2>, 2> ends;
    size_t count = 0;
    for (size_t k = 0; k < 3 && count < 2; ++k) {
      const double a = height[k], b = height[(k + 1) % 3];
      if ((a < 0) == (b < 0)) continue;
      const Vec3d place =
          triangle[k] + (triangle[(k + 1) % 3] - triangle[k]) * (a / (a - b)) - center;
      ends[count++] = {dot(across_u, place), dot(across_v, place)};
    }
    return count == 2 && meets_square(half, ends[0], ends[1]);
  });
}

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
        fmt::format("{} is ({}, {}, {}), in an object; a lamp must stand outside of all", field,
                    position.x, position.y, position.z));
  }
  const double reach = std::max({length(low), length(high), length(p)});
  return {p, std::max(dot(to_middle, to_middle), dot(to_corner, to_corner)), kRounding * reach};
}

}  // namespace itn::tracer
