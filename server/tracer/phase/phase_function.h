// The list of phase functions. A kind is a file, as two_term.h, an entry here, and a message in the
// PhaseFunction of itn/v1/render.proto. A kind has what PhaseFunctionKind and PhaseFunctionMaths
// list, and its fields (common/fields.h), of which at most kMaxPhaseSlots are slots.
#include <concepts>
#include <variant>

#include "server/tracer/phase/henyey_greenstein.h"
#include "server/tracer/phase/slots.h"
#include "server/tracer/phase/two_term.h"
#include "server/tracer/phase/von_mises_fisher.h"

#ifndef ITN_TRACER_PHASE_PHASE_FUNCTION_H_
#define ITN_TRACER_PHASE_PHASE_FUNCTION_H_

namespace itn::tracer {

using PhaseFunction = std::variant<HenyeyGreenstein, TwoTerm, VonMisesFisher>;

template <typename Kind>
concept PhaseFunctionKind = requires(const Kind& kind) {
  { kind.mean_cosine() } -> std::same_as<double>;
};

inline double mean_cosine(const PhaseFunction& phase) {
  return std::visit([](const PhaseFunctionKind auto& kind) { return kind.mean_cosine(); }, phase);
}

}  // namespace itn::tracer

#endif

#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_
#undef ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_
#else
#define ITN_TRACER_PHASE_PHASE_FUNCTION_MATHS_
#endif

#include "server/tracer/phase/phase_value-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// What a kind computes, for many angles at a time.
template <typename Kind>
concept PhaseFunctionMaths = requires(const Kind& kind, Floats cosine, Floats u) {
  // The density per steradian of angles with that cosine, and its scores.
  { evaluate(kind, cosine) } -> std::same_as<PhaseValue>;
  // A cosine that is distributed so, from a uniform number in [0, 1).
  { sample_cosine(kind, u) } -> std::same_as<Floats>;
};

HWY_INLINE PhaseValue evaluate(const PhaseFunction& phase, Floats cosine) {
  const Floats zero = hn::Zero(FloatTag());
  PhaseValue result{zero, {zero, zero, zero}};
  visit_kind(phase, [&](const PhaseFunctionMaths auto& kind) { result = evaluate(kind, cosine); });
  return result;
}

HWY_INLINE Floats sample_cosine(const PhaseFunction& phase, Floats u) {
  Floats result = set(1.0F);
  visit_kind(phase, [&](const auto& kind) { result = sample_cosine(kind, u); });
  return result;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
