// Colours in linear sRGB, and which part of them is rendered.
#pragma once

#include <array>

namespace itn::tracer {

using Rgb = std::array<double, 3>;

// Rec. 709 luminance.
inline double luminance(const Rgb& c) {
  return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
}

enum class Channel { kLuminance, kRed, kGreen, kBlue };

inline double select(const Rgb& c, Channel channel) {
  switch (channel) {
    case Channel::kLuminance: return luminance(c);
    case Channel::kRed: return c[0];
    case Channel::kGreen: return c[1];
    case Channel::kBlue: return c[2];
  }
  return 0;
}

}  // namespace itn::tracer
