// Straight lines to be followed, and how each of them ended (see reference/geometry.h).
#pragma once

#include "server/tracer/wavefront/columns.h"

namespace itn::tracer {

struct Rays {
  enum End : uint32_t { kSpent, kSurface, kEscaped, kLeaked };

  // In, and where it ended out (unless it escaped or leaked). A `surface` is the number of the
  // triangle that the point lies on, or Surfaces::kNone; `inside` is 0 or 1.
  VectorColumn position, direction;
  UintColumn inside{}, surface{};
  // In: the length in the medium to travel at most, in mm; and how far behind its position a line
  // begins to meet surfaces, 0 but for lines that were moved up to the object.
  FloatColumn budget{}, behind{};
  // Out.
  UintColumn end{}, entered{};  // the medium, or started in it: 0 or 1
  FloatColumn in_medium{};      // length travelled inside the medium, in mm
};

}  // namespace itn::tracer
