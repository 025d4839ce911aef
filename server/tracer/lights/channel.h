// Which part of a colour is rendered.
#pragma once

#include "server/tracer/lights/sky_model.h"

namespace itn::tracer {

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
