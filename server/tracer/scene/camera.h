// Pinhole camera, maybe behind a lens that distorts. Image x grows along
// cross(target - origin, up), image y downwards.
#pragma once

#include <cmath>

#include "common/vec.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

class Camera {
 public:
  // Throws Error (invalid input) if the view is degenerate.
  Camera(const CameraDescription& camera, const FilmDescription& film);

  // The way to film position (x, y) in pixels, as long as it advances by 1 along the view; pixel
  // (i, j) covers [i, i+1) x [j, j+1). In double: seen from 33 mm away, a float would move the
  // point by micrometres.
  Vec3d toward(double x, double y) const {
    const double right = x * scale_ - to_left_, down = y * scale_ - to_top_;
    const double factor = distorts_ ? undistorted(std::hypot(right, down)) : 1;
    return forward_ + right_ * (right * factor) + down_ * (down * factor);
  }
  Vec3d origin() const { return origin_; }

  struct FilmBox {
    double left, top, right, bottom;  // in pixels
    double depth;                     // of the nearest point of the box, along the view
    bool contains(double x, double y) const {
      return x >= left && x <= right && y >= top && y <= bottom;
    }
  };
  // Outside of which no ray meets a box; everything, with a depth of 0, if a part of it is not in
  // front of the camera.
  FilmBox film_box(Vec3d low, Vec3d high) const;

 private:
  // How much farther from the axis what is seen at a distance lies, both in focal lengths.
  double undistorted(double seen_at) const;
  // The distance at which what lies at r is seen, over r; and the slope of that distance in r,
  // above 0 as long as no two are seen at one.
  double factor(double r) const { return 1 + r * r * (k_1_ + k_2_ * r * r); }
  double slope(double r) const { return 1 + r * r * (3 * k_1_ + 5 * k_2_ * r * r); }
  FilmBox distorted(const FilmBox& at_unit_distance) const;
  void check_distortion(const FilmDescription& film) const;

  Vec3d origin_, forward_, right_, down_;
  double k_1_, k_2_;
  bool distorts_;
  double scale_, to_left_, to_top_;  // of a pixel, and of the film's sides, at unit distance
};

}  // namespace itn::tracer
