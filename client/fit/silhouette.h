// What a mesh covers of an image, quickly: depth and normal of what is seen, pixel by pixel.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/pose.h"
#include "common/vec.h"

namespace itn {

// A pinhole at the origin that looks along -z, with y up, and its square image. In pixels, from the
// image's left and top: a pixel's middle is at .5.
struct PinholeView {
  double focal = 1;                   // what is as far to the side as ahead is so far from the axis
  double center_x = 0, center_y = 0;  // where the axis meets the image; may lie outside of it
  int side = 1;

  Vec3d direction(double x, double y) const;  // towards a place of the image, of any length
  // The same view in an image of another side.
  PinholeView at_side(int other) const;
};

// From a pixel to those that share an edge with it.
inline constexpr std::array<std::pair<int, int>, 4> kBeside{{{-1, 0}, {1, 0}, {0, -1}, {0, 1}}};

// A place on the mesh where a silhouette ends.
struct ContourPoint {
  double x = 0, y = 0;  // between a pixel of the object and a neighbour beside it
  Vec3d place;          // what is seen there, in the coordinates of the mesh
};

// Moments of an image that is 1 where the object is.
struct SilhouetteMoments {
  double area = 0, x = 0, y = 0;  // in pixels; the middle
  double angle = 0;               // of the longer axis to the right, counter-clockwise, in radians
  double elongation = 1;          // the longer axis over the shorter one
};

class Silhouette {
 public:
  // Draws a closed mesh. Triangles that reach behind the camera are left out.
  Silhouette(const Mesh& mesh, const Pose& pose, const PinholeView& view);

  bool covers(int x, int y) const {
    return depth_[index(x, y)] < std::numeric_limits<float>::infinity();
  }
  // How far what is seen at a pixel that is covered lies along -z; and how its triangle is turned,
  // in the coordinates of the camera.
  double depth(int x, int y) const { return double{depth_[index(x, y)]}; }
  Vec3d normal(const Mesh& mesh, int x, int y) const;
  // Whether the square of pixels from a corner on, and the pixels around it, are covered.
  bool covers_square(int left, int top, int side) const;
  // Whether they show one surface, too: nowhere the contour of a part of the mesh before another.
  bool shows_one_surface(int left, int top, int side) const;
  std::vector<ContourPoint> contour() const;
  // In [0, 1]: pixels that are above half in the mask and covered here, over those that are either.
  double overlap(const std::vector<float>& mask) const;
  SilhouetteMoments moments() const;
  // The mean difference of the depths, in mm, where both cover a pixel.
  double depth_difference(const Silhouette& other) const;
  // The same after one of them is moved along the view until the median difference is 0.
  double relief_difference(const Silhouette& other) const;

 private:
  size_t index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(view_.side) + static_cast<size_t>(x);
  }
  // Whether the depth is about the same at two pixels that are covered.
  bool are_level(int x, int y, int other_x, int other_y) const;
  std::vector<double> differences(const Silhouette& other) const;

  Pose pose_;
  PinholeView view_;
  std::vector<float> depth_;  // along -z; infinite where nothing is
  std::vector<uint32_t> triangle_;
};

SilhouetteMoments moments_of(const std::vector<float>& mask, int side);

}  // namespace itn
