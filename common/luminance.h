// Luminance of colours in linear sRGB.
#pragma once

#include <array>

namespace itn {

// The parts that red, green and blue have in it (Rec. 709).
inline constexpr std::array kLuminanceOfColours{0.2126, 0.7152, 0.0722};

inline double luminance(const std::array<double, 3>& colour) {
  return kLuminanceOfColours[0] * colour[0] + kLuminanceOfColours[1] * colour[1] +
         kLuminanceOfColours[2] * colour[2];
}

}  // namespace itn
