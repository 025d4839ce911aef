// The curve of screens and of photographs that are developed for them (IEC 61966-2-1), between
// linear light and encoded values, both in [0, 1].
#pragma once

#include <cmath>

namespace itn {

inline double linear_of_srgb(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

inline double srgb_of_linear(double linear) {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

}  // namespace itn
