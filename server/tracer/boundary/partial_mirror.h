// A film on the boundary that mirrors a part of the light, absorbs another, and lets the rest pass
// straight, whatever its direction. Closed forms are known of it, for tests.
#pragma once

#include <array>

#include "common/vec.h"
#include "server/tracer/boundary/crossing.h"

namespace itn::tracer {

struct PartialMirror {
  float reflected = 0, absorbed = 0;  // parts of the light, together at most 1

  BoundarySample sample(const Crossing& at, const std::array<float, 5>& u) const {
    if (u[0] < absorbed) return {};
    if (u[0] >= absorbed + reflected) return {BoundarySample::Event::kTransmitted, at.direction, 1};
    const Vec3f mirrored = at.direction - at.normal * (2 * dot(at.direction, at.normal));
    return {BoundarySample::Event::kReflected, itn::normalize(mirrored), 1};
  }
};

}  // namespace itn::tracer
