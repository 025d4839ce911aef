// The list of phase functions. A kind is a file, as henyey_greenstein.h, and an entry here.
#ifndef ITN_TRACER_PHASE_PHASE_FUNCTION_H_
#define ITN_TRACER_PHASE_PHASE_FUNCTION_H_

#include <variant>

#include "server/tracer/phase/henyey_greenstein.h"

namespace itn::tracer {

using PhaseFunction = std::variant<HenyeyGreenstein>;

}  // namespace itn::tracer

#endif

#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_
#undef ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_
#else
#define ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_
#endif

#include "server/tracer/phase/henyey_greenstein.h"
#include "server/tracer/phase/phase_value-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

template <typename F>
HWY_INLINE PhaseValue<F> evaluate(const PhaseFunction& phase, F cos_theta) {
  PhaseValue<F> result{splat<F>(0), splat<F>(0)};
  visit_kind(phase, [&](const auto& kind) { result = evaluate(kind, cos_theta); });
  return result;
}

template <typename F>
HWY_INLINE F sample_cosine(const PhaseFunction& phase, F u) {
  F result = splat<F>(1);
  visit_kind(phase, [&](const auto& kind) { result = sample_cosine(kind, u); });
  return result;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
