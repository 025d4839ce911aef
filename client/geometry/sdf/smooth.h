// The smaller and the larger of two distances, rounded where they are nearly the same.
#pragma once

#include <algorithm>
#include <cmath>

namespace itn::sdf {

// The minimum where they differ by `fillet` (> 0) or more; between, a parabola that is smaller. A
// mean of both slopes everywhere, so no steeper than the steeper of them.
inline float smooth_min(float a, float b, float fillet) {
  const float h = std::max(fillet - std::abs(a - b), 0.0F);
  return std::min(a, b) - h * h * (0.25F / fillet);
}

inline float smooth_max(float a, float b, float fillet) {
  return -smooth_min(-a, -b, fillet);
}

}  // namespace itn::sdf
