// What light does where it crosses the boundary of the medium.
//
// An index-matched boundary does nothing: a line runs through any number of entries and exits in
// one go. At every other kind a line ends, and the crossing is a vertex of the path, where the kind
// draws the direction to go on with. Shadow rays end at such a boundary and bring nothing, as the
// straight line to the light is not a path of light. In return, nothing competes with the walk for
// the light that it meets on the line behind such a crossing: no weight of multiple importance
// sampling applies there. DirectionalLight, which no walk meets by itself, is thus not seen through
// it.
//
// A path that crosses more than kMaxConsecutiveCrossings times in a row, without scattering or
// reflection by a surface in between, counts as trapped by rounding, and is dropped as leaked.
//
// A new kind is a file and an entry of Boundary. It takes no part in derivatives.
#pragma once

#include <array>
#include <cstdint>
#include <variant>

#include "server/tracer/boundary/crossing.h"
#include "server/tracer/boundary/index_matched.h"
#include "server/tracer/boundary/partial_mirror.h"

namespace itn::tracer {

using Boundary = std::variant<IndexMatched, PartialMirror>;

constexpr uint32_t kMaxConsecutiveCrossings = 1000;

inline bool stops_lines(const Boundary& boundary) {
  return !std::holds_alternative<IndexMatched>(boundary);
}

// How a path goes on behind a crossing. `u` are uniform in [0, 1).
inline BoundarySample sample(const Boundary& boundary, const Crossing& at,
                             const std::array<float, 5>& u) {
  return std::visit([&](const auto& kind) { return kind.sample(at, u); }, boundary);
}

}  // namespace itn::tracer
