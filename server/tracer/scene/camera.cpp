#include "server/tracer/scene/camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/error.h"

namespace itn::tracer {

Camera::Camera(const CameraDescription& camera, const FilmDescription& film)
    : origin_(camera.origin) {
  if (!is_finite(camera.origin) || !is_finite(camera.target) || !is_finite(camera.up)) {
    throw invalid_input("camera: origin, target and up must be finite");
  }
  if (!(camera.fov > 0 && camera.fov < std::numbers::pi)) {
    throw invalid_input(
        fmt::format("camera: the field of view is {} radians; it must be in (0, pi)", camera.fov));
  }
  const Vec3d view = camera.target - camera.origin;
  const Vec3d sideways = cross(view, camera.up);
  if (!(length(sideways) > 1e-9 * length(view) * length(camera.up))) {
    throw invalid_input(
        "camera: target must differ from origin, and up not be parallel to the view");
  }
  forward_ = itn::normalize(view);
  right_ = itn::normalize(sideways);
  down_ = cross(forward_, right_);
  half_width_ = std::tan(camera.fov / 2);
  scale_ = 2 * half_width_ / film.width;
  half_height_ = scale_ * film.height / 2;
}

Camera::FilmBox Camera::film_box(Vec3d low, Vec3d high) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  FilmBox box{kInfinity, kInfinity, -kInfinity, -kInfinity, kInfinity};
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d v = Vec3d{corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y,
                          corner & 4 ? high.z : low.z} -
                    origin_;
    const double depth = dot(v, forward_);
    if (!(depth > 1e-6 * length(v))) return {-kInfinity, -kInfinity, kInfinity, kInfinity, 0};
    const double x = (dot(v, right_) / depth + half_width_) / scale_;
    const double y = (dot(v, down_) / depth + half_height_) / scale_;
    box = {std::min(box.left, x), std::min(box.top, y), std::max(box.right, x),
           std::max(box.bottom, y), std::min(box.depth, depth)};
  }
  return box;
}

}  // namespace itn::tracer
