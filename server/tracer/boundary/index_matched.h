// The medium and what is around it have one index of refraction: light passes as if there were no
// boundary.
#pragma once

#include <array>

#include "server/tracer/boundary/crossing.h"

namespace itn::tracer {

struct IndexMatched {
  BoundarySample sample(const Crossing& at, const std::array<float, 5>& /*u*/) const {
    return {BoundarySample::Event::kTransmitted, at.direction, 1};
  }
};

}  // namespace itn::tracer
