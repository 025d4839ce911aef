// The same names for one float and for a vector of lanes: what a kind computes is written once,
// over F. Operators + - * / are those of float, and Highway's. Lanes fuse where it says so; one
// float does not.
#if defined(ITN_TRACER_SIMD_EITHER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SIMD_EITHER_INL_H_
#undef ITN_TRACER_SIMD_EITHER_INL_H_
#else
#define ITN_TRACER_SIMD_EITHER_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <variant>

#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// A constant.
template <typename F>
HWY_INLINE F splat(float v) {
  if constexpr (std::is_same_v<F, float>) {
    return v;
  } else {
    return set(v);
  }
}

HWY_INLINE float mul_add(float a, float b, float c) {
  return a * b + c;
}

HWY_INLINE float square_root(float v) {
  return std::sqrt(v);
}
HWY_INLINE Floats square_root(Floats v) {
  return hn::Sqrt(v);
}

HWY_INLINE float clamp(float v, float low, float high) {
  return std::min(std::max(v, low), high);
}
HWY_INLINE Floats clamp(Floats v, float low, float high) {
  return hn::Clamp(v, set(low), set(high));
}

// Calls use(kind) for the kind that it is. Not std::visit, whose functions are compiled for no
// instruction set in particular.
template <typename... Kinds, typename Use>
HWY_INLINE void visit_kind(const std::variant<Kinds...>& kind, const Use& use) {
  const auto try_one = [&](const auto* one) {
    if (one != nullptr) use(*one);
  };
  (try_one(std::get_if<Kinds>(&kind)), ...);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
