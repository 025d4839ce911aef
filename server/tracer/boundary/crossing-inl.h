// What paths are at when they cross a boundary, and what it does with them. Paths start at the
// camera: light goes the other way. Directions are of unit length.
//
// Radiance means radiance / index^2 here, of the index of where it is, which a boundary that loses
// nothing hands on as it is: so weights need not know on which side they are.
#if defined(ITN_TRACER_BOUNDARY_CROSSING_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_BOUNDARY_CROSSING_INL_H_
#undef ITN_TRACER_BOUNDARY_CROSSING_INL_H_
#else
#define ITN_TRACER_BOUNDARY_CROSSING_INL_H_
#endif

#include "server/tracer/boundary/slots.h"
#include "server/tracer/random/philox-inl.h"
#include "server/tracer/simd/kinds-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

struct Crossing {
  Vectors direction;  // in which paths arrive
  Vectors normal;     // of the boundary, on the side that they arrive at
  Mask leaving;       // whether that is the side of the medium
};

// `outwards`: the normal on the outer side.
HWY_INLINE Crossing crossing_of(Vectors direction, Vectors outwards, Mask leaving) {
  const Floats zero = hn::Zero(FloatTag());
  return {direction, if_then_else(leaving, Vectors{zero, zero, zero} - outwards, outwards),
          leaving};
}

// In which directions paths go on.
struct BoundarySample {
  Vectors direction;
  Mask transmitted;                  // to the other side
  Floats weight;                     // value / pdf; 0: the light is absorbed
  Floats pdf;                        // per steradian; of a boundary that is a delta, 0
  Floats scores[kMaxBoundarySlots];  // see BoundaryValue
};

// What light from a direction brings.
struct BoundaryValue {
  Floats value;                      // that part of its radiance by steradian, the cosine included
  Floats pdf;                        // with which that direction is drawn, per steradian
  Floats scores[kMaxBoundarySlots];  // the derivatives of log value in the slots of the kind
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
