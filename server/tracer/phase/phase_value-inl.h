// What a phase function says of an angle.
#if defined(ITN_TRACER_PHASE_PHASE_VALUE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_PHASE_VALUE_INL_H_
#undef ITN_TRACER_PHASE_PHASE_VALUE_INL_H_
#else
#define ITN_TRACER_PHASE_PHASE_VALUE_INL_H_
#endif

#include "server/tracer/phase/slots.h"
#include "server/tracer/simd/kinds-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

struct PhaseValue {
  Floats value;                   // per steradian
  Floats scores[kMaxPhaseSlots];  // its logarithm's derivatives in the slots of the kind
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
