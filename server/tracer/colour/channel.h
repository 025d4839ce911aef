// Colours in linear sRGB, and which part of them is rendered.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "common/luminance.h"

namespace itn::tracer {

using Rgb = std::array<double, 3>;

// A table of floats for each colour: red, green and blue of an entry lie side by side, as who looks
// one up wants all.
using RgbTable = std::vector<float>;

// What a film shows. All three colours of kRgb are rendered, and luminance tells how.
enum class Channel { kLuminance, kRed, kGreen, kBlue, kRgb };
inline constexpr std::array kColours{Channel::kRed, Channel::kGreen, Channel::kBlue};

inline double select(const Rgb& c, Channel channel) {
  switch (channel) {
    case Channel::kLuminance:
    case Channel::kRgb: return luminance(c);
    case Channel::kRed: return c[0];
    case Channel::kGreen: return c[1];
    case Channel::kBlue: return c[2];
  }
  return 0;
}

}  // namespace itn::tracer
