// One colour everywhere.
#ifndef ITN_TRACER_SURFACES_COLOR_REFLECTANCE_H_
#define ITN_TRACER_SURFACES_COLOR_REFLECTANCE_H_

#include <array>
#include <cstddef>

#include "common/geometry/pose.h"
#include "server/tracer/colour/channel.h"

namespace itn::tracer {

struct ColorReflectance {
  float red = 0.5F, green = 0.5F, blue = 0.5F;
  std::array<float, 3> parts = {};  // once it is compiled: of each in what the film shows

  static constexpr const char* kName = "color";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("red", self.red, 0, 1);
    to.slot("green", self.green, 0, 1);
    to.slot("blue", self.blue, 0, 1);
  }
  ColorReflectance compile(const Pose& /*pose*/, Channel channel) const {
    ColorReflectance compiled = *this;
    for (size_t c = 0; c < 3; ++c) {
      Rgb one{};
      one[c] = 1;
      compiled.parts[c] = static_cast<float>(select(one, channel));
    }
    return compiled;
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_SURFACES_COLOR_REFLECTANCE_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SURFACES_COLOR_REFLECTANCE_MATHS_
#undef ITN_TRACER_SURFACES_COLOR_REFLECTANCE_MATHS_
#else
#define ITN_TRACER_SURFACES_COLOR_REFLECTANCE_MATHS_
#endif

#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Floats reflectance_at(const ColorReflectance& color, Vectors /*p*/) {
  const auto& parts = color.parts;
  return set(color.red * parts[0] + color.green * parts[1] + color.blue * parts[2]);
}
HWY_INLINE Floats reflectance_slope(const ColorReflectance& color, size_t slot, Vectors /*p*/) {
  return set(color.parts[slot]);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
