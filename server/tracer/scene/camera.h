// Pinhole camera. Image x grows along cross(target - origin, up), image y downwards.
#pragma once

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
    return forward_ + right_ * (x * scale_ - half_width_) + down_ * (y * scale_ - half_height_);
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
  Vec3d origin_, forward_, right_, down_;
  double half_width_, half_height_, scale_;  // of the film at unit distance
};

}  // namespace itn::tracer
