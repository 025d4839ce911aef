// The curve of screens and of photographs that are developed for them.
#pragma once

#include <cmath>

namespace itn {

// Linear light in [0, 1] of an encoded value in [0, 1] (IEC 61966-2-1).
inline double linear_of_srgb(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

}  // namespace itn
