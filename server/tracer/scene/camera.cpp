#include "server/tracer/scene/camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/error.h"

namespace itn::tracer {

Camera::Camera(const CameraDescription& camera, const FilmDescription& film)
    : origin_(camera.origin),
      k_1_(camera.k_1),
      k_2_(camera.k_2),
      distorts_(camera.k_1 != 0 || camera.k_2 != 0) {
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
  if (!(camera.left < camera.right && camera.top < camera.bottom)) {
    throw invalid_input("camera: left must be below right, and top below bottom");
  }
  const double width = 2 * std::tan(camera.fov / 2);
  scale_ = width * (camera.right - camera.left) / film.width;
  const double height = scale_ * film.height / (camera.bottom - camera.top);
  to_left_ = width * (camera.principal_x - camera.left);
  to_top_ = height * (camera.principal_y - camera.top);
  if (distorts_) check_distortion(film);
}

// By Newton's method, from where it is seen.
double Camera::undistorted(double seen_at) const {
  double r = seen_at;
  for (int step = 0; step < 8; ++step) r -= (r * factor(r) - seen_at) / slope(r);
  return seen_at > 0 ? r / seen_at : 1;
}

// What is seen at the corners of the film is one place, and so is what is seen between.
void Camera::check_distortion(const FilmDescription& film) const {
  const double x = std::max(std::abs(to_left_), std::abs(film.width * scale_ - to_left_));
  const double y = std::max(std::abs(to_top_), std::abs(film.height * scale_ - to_top_));
  const double corner = std::hypot(x, y);
  constexpr int kSteps = 1000;
  // Far enough, unless what is seen there lies at four times the distance.
  double r = 0;
  for (int i = 0; i <= 4 * kSteps && r * factor(r) < corner; ++i) {
    r = corner * i / kSteps;
    if (!(slope(r) > 0.1)) break;
  }
  if (!(r * factor(r) >= corner && slope(r) > 0.1)) {
    throw invalid_input(
        fmt::format("camera: with k_1 {:g} and k_2 {:g}, no place, or more than one, is seen at "
                    "a corner of the film; the distortion is too strong for its field of view",
                    k_1_, k_2_));
  }
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
    const double x = dot(v, right_) / depth, y = dot(v, down_) / depth;
    box = {std::min(box.left, x), std::min(box.top, y), std::max(box.right, x),
           std::max(box.bottom, y), std::min(box.depth, depth)};
  }
  if (distorts_) box = distorted(box);
  return {(box.left + to_left_) / scale_, (box.top + to_top_) / scale_,
          (box.right + to_left_) / scale_, (box.bottom + to_top_) / scale_, box.depth};
}

// A box around what is seen of one, at unit distance: its sides times the least and the largest
// factor between its points nearest to the axis and farthest from it.
Camera::FilmBox Camera::distorted(const FilmBox& box) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto nearest = [](double low, double high) { return std::clamp(0.0, low, high); };
  const auto farthest = [](double low, double high) { return std::max(-low, high); };
  const double from = std::hypot(nearest(box.left, box.right), nearest(box.top, box.bottom));
  const double to = std::hypot(farthest(box.left, box.right), farthest(box.top, box.bottom));
  double least = kInfinity, most = -kInfinity;
  const auto look_at = [&](double r) {
    least = std::min(least, factor(r));
    most = std::max(most, factor(r));
  };
  look_at(from);
  look_at(to);
  if (const double square = -k_1_ / (2 * k_2_); square > from * from && square < to * to) {
    look_at(std::sqrt(square));  // where the factor is extreme
  }
  const auto low = [&](double side) { return side * (side < 0 ? most : least); };
  const auto high = [&](double side) { return side * (side < 0 ? least : most); };
  return {low(box.left), low(box.top), high(box.right), high(box.bottom), box.depth};
}

}  // namespace itn::tracer
