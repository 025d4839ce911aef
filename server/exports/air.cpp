#include "server/exports/air.h"

#include <algorithm>
#include <cmath>

namespace itn {
namespace {

// Of the largest coordinate, in mm, plus 1. Rays start as Mitsuba 3 has it (Interaction::spawn_ray,
// in single precision).
constexpr double kAir = 2e-3, kTouch = 1e-4, kRays = 8.9e-5;

double size_of(const Mesh& mesh) {
  const Bounds box = bounds(mesh);
  return 1 +
         double{std::max({-box.min.x, -box.min.y, -box.min.z, box.max.x, box.max.y, box.max.z})};
}

// Along one direction.
struct Range {
  double least = HUGE_VAL, most = -HUGE_VAL;
  void add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  bool meets(double low, double high) const { return least <= high && most >= low; }
};

// On which side of the rectangle an object is that touches it: that to which its normal points (1),
// or the other (-1); 0 where it does not, or goes through it. What of the object lies in its plane
// is taken for a rectangle along its sides.
int side_of_touching(const Mesh& object, const std::array<Vec3d, 4>& corners, Vec3d normal,
                     double touch) {
  const Vec3d u = corners[1] - corners[0], v = corners[3] - corners[0];
  const Vec3d across = cross(normal, v), down = cross(u, normal);
  Range height, x, y;
  for (const Vec3f vertex : object.vertices) {
    const Vec3d from_corner = static_cast<Vec3d>(vertex) - corners[0];
    const double distance = dot(from_corner, normal);
    height.add(distance);
    if (std::abs(distance) > touch) continue;
    x.add(dot(from_corner, across) / dot(u, across));
    y.add(dot(from_corner, down) / dot(v, down));
  }
  if (!x.meets(0, 1) || !y.meets(0, 1)) return 0;
  if (height.least < -touch && height.most > touch) return 0;
  return height.most > touch ? 1 : -1;
}

}  // namespace

Contact contact_of(const std::array<Vec3d, 4>& rectangle, std::span<const Mesh> objects) {
  const Vec3d normal = normalize(cross(rectangle[1] - rectangle[0], rectangle[3] - rectangle[0]));
  double above = 0, below = 0;  // the air that is needed on either side
  for (const Mesh& object : objects) {
    const double size = size_of(object);
    const int side = side_of_touching(object, rectangle, normal, kTouch * size);
    double& needed = side > 0 ? above : below;
    if (side != 0) needed = std::max(needed, kAir * size);
  }
  const bool is_between = above > 0 && below > 0;
  return {.touches = above > 0 || below > 0,
          .away = is_between ? Vec3d{} : normal * (below - above)};
}

double start_of_rays(const Mesh& mesh) {
  return kRays * size_of(mesh);
}

bool may_touch(const Mesh& a, const Mesh& b) {
  const double touch = kTouch * std::max(size_of(a), size_of(b));
  const Bounds one = bounds(a), other = bounds(b);
  const auto meet = [&](float low, float high, float other_low, float other_high) {
    return low <= other_high + touch && high >= other_low - touch;
  };
  return meet(one.min.x, one.max.x, other.min.x, other.max.x) &&
         meet(one.min.y, one.max.y, other.min.y, other.max.y) &&
         meet(one.min.z, one.max.z, other.min.z, other.max.z);
}

}  // namespace itn
