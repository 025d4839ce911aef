// Straight lines, followed by the instruction set that there is.
#pragma once

#include <cstddef>

#include "server/tracer/geometry/obstacles.h"
#include "server/tracer/geometry/rays.h"

namespace itn::tracer {

// Follows the first `count` rays, through an index-matched boundary.
void follow(const Obstacles& obstacles, Rays& rays, size_t count);

}  // namespace itn::tracer
