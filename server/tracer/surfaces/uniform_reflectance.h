// One reflectance everywhere.
#ifndef ITN_TRACER_SURFACES_UNIFORM_REFLECTANCE_H_
#define ITN_TRACER_SURFACES_UNIFORM_REFLECTANCE_H_

#include "common/geometry/pose.h"
#include "server/tracer/colour/channel.h"

namespace itn::tracer {

struct UniformReflectance {
  float value = 0.5F;

  static constexpr const char* kName = "";  // a field of the surface itself
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("reflectance", self.value, 0, 1);
  }
  UniformReflectance compile(const Pose& /*pose*/, Channel /*channel*/) const { return *this; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_SURFACES_UNIFORM_REFLECTANCE_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SURFACES_UNIFORM_REFLECTANCE_MATHS_
#undef ITN_TRACER_SURFACES_UNIFORM_REFLECTANCE_MATHS_
#else
#define ITN_TRACER_SURFACES_UNIFORM_REFLECTANCE_MATHS_
#endif

#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Floats reflectance_at(const UniformReflectance& uniform, Vectors /*p*/) {
  return set(uniform.value);
}
HWY_INLINE Floats reflectance_slope(const UniformReflectance& /*uniform*/, size_t /*slot*/,
                                    Vectors /*p*/) {
  return set(1.0F);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
