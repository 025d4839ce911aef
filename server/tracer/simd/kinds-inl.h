// Kinds that are held in a std::variant.
#if defined(ITN_TRACER_SIMD_KINDS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SIMD_KINDS_INL_H_
#undef ITN_TRACER_SIMD_KINDS_INL_H_
#else
#define ITN_TRACER_SIMD_KINDS_INL_H_
#endif

#include <variant>

#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

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
