// What a phase function says of an angle.
#if defined(ITN_TRACER_PHASE_PHASE_VALUE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_PHASE_VALUE_INL_H_
#undef ITN_TRACER_PHASE_PHASE_VALUE_INL_H_
#else
#define ITN_TRACER_PHASE_PHASE_VALUE_INL_H_
#endif

#include "server/tracer/simd/either-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

template <typename F>
struct PhaseValue {
  F value;  // per steradian
  F score;  // its logarithm's derivative in the parameter
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
