// Angles are in radians but in messages and files, where they are in degrees.
#pragma once

#include <numbers>

namespace itn {

inline constexpr double kRadiansPerDegree = std::numbers::pi / 180;

}  // namespace itn
