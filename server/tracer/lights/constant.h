// Light of one radiance from all directions.
#ifndef ITN_TRACER_LIGHTS_CONSTANT_H_
#define ITN_TRACER_LIGHTS_CONSTANT_H_

#include <numbers>

#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

struct ConstantLight {
  double radiance = 1;

  static constexpr const char* kName = "constant";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.number("radiance", self.radiance, 0, 1e9);
  }
  ConstantLight compile(const LightFrame& /*frame*/) const { return *this; }

  static constexpr bool kDelta = false, kDistant = true;
  static constexpr double kPdf = 1 / (4 * std::numbers::pi);

  double power() const { return radiance / kPdf; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_CONSTANT_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_CONSTANT_MATHS_
#undef ITN_TRACER_LIGHTS_CONSTANT_MATHS_
#else
#define ITN_TRACER_LIGHTS_CONSTANT_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Emission emission(const ConstantLight& light, Vectors) {
  constexpr auto kPdf = static_cast<float>(ConstantLight::kPdf);
  return {set(static_cast<float>(light.radiance)), set(kPdf)};
}

HWY_INLINE Vectors sample(const ConstantLight&, const LightUniforms& u) {
  const Floats y = 1 - (u.u0 + u.u0);
  const Floats r = hn::Sqrt(hn::Max(hn::Zero(FloatTag()), 1 - y * y));
  const SinCos phi = sin_cos_2pi(u.u1);
  return {r * phi.cos, y, r * phi.sin};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
