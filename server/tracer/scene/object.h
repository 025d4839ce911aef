// The boundary of the medium, compiled: what rays are traced against, in the coordinates of its
// mesh. Internal to the tracer, but for those who share objects between scenes.
#pragma once

#include <cstddef>
#include <memory>
#include <stop_token>
#include <string>

#include "common/geometry/mesh.h"
#include "server/tracer/wavefront/depths.h"
#include "server/tracer/wavefront/grid.h"

namespace itn::tracer {

class Object {
 public:
  // The mesh bounds a volume (validate_closed). Throws Error (cancelled) soon after a stop is
  // requested.
  explicit Object(Mesh closed, const std::stop_token& stop = {});

  size_t memory() const;

  Mesh mesh;
  Bounds bounds;
  float extent;  // largest absolute coordinate
  Grid grid;
  Depths depths;
};

// Checks the mesh and compiles it. `what` names it in messages. Throws Error (invalid input) unless
// it bounds a volume; Error (cancelled).
std::shared_ptr<const Object> compile_object(Mesh mesh, const std::string& what,
                                             const std::stop_token& stop = {});

}  // namespace itn::tracer
