// The boundary of the medium, compiled: what rays are traced against, in the coordinates of its
// mesh. Internal to the tracer, but for those who share objects between scenes.
#pragma once

#include <cstddef>
#include <memory>
#include <stop_token>
#include <string>

#include "common/geometry/mesh.h"
#include "server/tracer/geometry/depth_grid.h"
#include "server/tracer/geometry/grid.h"

namespace itn::tracer {

// What floats resolve: the longest side of an object is this many mm at least, so that products of
// lengths do not underflow, and this part at least of its largest coordinate and of the distance
// to the camera, so that coordinates and directions are right to a per cent of it.
constexpr double kSmallestLength = 1e-6;
constexpr double kSmallestPart = 2e-5;
// Its thickness (common/geometry/mesh.h) is this part at least of its largest coordinate: twelve
// times what a line may miss the boundary by (geometry/line_geometry.h).
constexpr double kSmallestThickness = 6e-6;

class Object {
 public:
  // The mesh bounds a volume (validate_closed). Throws Error (cancelled) soon after a stop is
  // requested.
  explicit Object(Mesh closed, const std::stop_token& stop = {});

  size_t memory() const;

  Mesh mesh;
  Bounds bounds;
  float extent;      // largest absolute coordinate
  double length;     // of the longest side of the bounds
  double thickness;  // common/geometry/mesh.h
  Grid grid;
  DepthGrid depth_grid;
};

// Checks the mesh and compiles it. `what` names it in messages. Throws Error (invalid input) unless
// it bounds a volume that floats resolve; Error (cancelled).
std::shared_ptr<const Object> compile_object(Mesh mesh, const std::string& what,
                                             const std::stop_token& stop = {});

}  // namespace itn::tracer
