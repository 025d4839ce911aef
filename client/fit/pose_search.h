// Finds where an object of known shape stands by its silhouette in a photograph: all views are
// tried, and the best are moved until their contours lie on that of the mask.
#pragma once

#include <cstddef>
#include <stop_token>
#include <vector>

#include "client/fit/silhouette.h"

namespace itn {

// The object turns about its middle, by radians about an axis, and shifts, in mm of the camera's
// coordinates.
struct PoseMove {
  Vec3d turn, shift;
};

struct FoundPose {
  Pose pose;            // of the mesh, in front of the camera of PinholeView
  double overlap = 0;   // of mask and silhouette, in [0, 1]: pixels of both over pixels of either
  double distance = 0;  // of the contours, in pixels of the mask: the root of the mean square
  // What the contour leaves open, if its points are off by `distance`, as standard deviations: the
  // angle in degrees, about the axis that is known least, and the part of the distance to the
  // camera.
  double angle_error = 0, range_error = 0;
  std::vector<PoseMove> errors;  // a standard deviation of each of six independent ones
};

struct PoseSearch {
  size_t views = 1500;  // directions from which the object is looked at, evenly spread
  size_t moved = 96;    // best of them whose contours are matched
};

// The best first: those whose contours lie as near as the nearest does, within what the pixels
// tell, of poses in which the camera sees something else: one that turns a symmetric shape into
// itself is left out. `mask`: side x side pixels in [0, 1] of the view, top row first. Throws Error
// (invalid input) if the mask shows nothing, or the object reaches behind the camera wherever it
// stands; (cancelled).
std::vector<FoundPose> find_poses(const Mesh& mesh, const std::vector<float>& mask,
                                  const PinholeView& view, const PoseSearch& search = {},
                                  const std::stop_token& stop = {});

// Moves a pose until its contour lies on that of the mask.
FoundPose matched(const Mesh& mesh, const std::vector<float>& mask, const PinholeView& view,
                  const Pose& start);

// `times` as far.
Pose moved(const Pose& pose, Vec3d middle, const PoseMove& by, double times = 1);

// Between two rotations, in radians.
double angle_between(const Rotation<double>& a, const Rotation<double>& b);

}  // namespace itn
