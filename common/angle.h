// Angles are in radians but in messages and files, where they are in degrees.
#pragma once

#include <cmath>
#include <numbers>

#include "common/vec.h"

namespace itn {

inline constexpr double kRadiansPerDegree = std::numbers::pi / 180;

// A direction of unit length; an azimuth of 0 is -z, 90 is +x; elevation is over the horizon, +y.
inline Vec3d direction_at(double azimuth_degrees, double elevation_degrees) {
  const double azimuth = azimuth_degrees * kRadiansPerDegree;
  const double elevation = elevation_degrees * kRadiansPerDegree;
  return {std::sin(azimuth) * std::cos(elevation), std::sin(elevation),
          -std::cos(azimuth) * std::cos(elevation)};
}

}  // namespace itn
