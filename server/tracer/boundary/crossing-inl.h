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
  // On the side that they arrive at: of the boundary, and of the triangle that stands for it.
  Vectors normal, flat_normal;
  Mask leaving;  // whether that is the side of the medium
  bool flat;     // these are the same
  BoundaryDerivatives asked;
  Vectors straight_normal;  // `normal` before it was bent
};

HWY_INLINE Vectors facing(Mask leaving, Vectors outwards) {
  return if_then_else(leaving, set(Vec3f{}) - outwards, outwards);
}

// The normal is bent until a mirror does not send light through the triangle: halfway between where
// the path comes from, and a direction that is just outside.
struct Lift {
  Vectors back, lifted;  // these directions; the latter of any length
  Mask needed;
};
HWY_INLINE Lift lift_of(Vectors direction, Vectors normal, Vectors flat_normal) {
  const Floats zero = hn::Zero(FloatTag());
  const Vectors back = Vectors{zero, zero, zero} - direction;
  const Vectors mirror = normal * (2 * dot(back, normal)) - back;
  const Floats height = dot(mirror, flat_normal);
  const Floats arrival = hn::Max(dot(back, flat_normal), set(1e-6F));
  const Floats least = hn::Min(0.9F * arrival, set(0.01F));
  return {back, mirror + flat_normal * (least - height),
          (height < least) | (dot(back, normal) <= 0)};
}

// The normals on the outer side.
HWY_INLINE Crossing crossing_of(Vectors direction, Vectors outwards, Vectors flat_outwards,
                                Mask leaving, bool flat, BoundaryDerivatives asked) {
  const Vectors flat_normal = facing(leaving, flat_outwards);
  if (flat) return {direction, flat_normal, flat_normal, leaving, true, asked, flat_normal};
  const Vectors normal = facing(leaving, outwards);
  const Lift lift = lift_of(direction, normal, flat_normal);
  const Vectors bent = normalize(lift.back + normalize(lift.lifted));
  return {direction, if_then_else(lift.needed, bent, normal), flat_normal, leaving, false, asked,
          normal};
}

// The derivative of something in the normal that faces outwards, from that in `normal`.
HWY_INLINE Vectors slope_outwards(const Crossing& crossing, Vectors slope) {
  if (crossing.flat) return facing(crossing.leaving, slope);
  const auto across = [](Vectors v, Vectors unit) { return v - unit * dot(v, unit); };
  const auto shorter = [](Vectors v, Floats by) { return v * (1 / by); };
  const auto length = [](Vectors v) { return hn::Sqrt(hn::Max(dot(v, v), set(1e-12F))); };
  const Lift lift = lift_of(crossing.direction, crossing.straight_normal, crossing.flat_normal);
  const Floats lifted_length = length(lift.lifted);
  const Vectors lifted = shorter(lift.lifted, lifted_length);
  const Vectors by_lifted = shorter(across(slope, crossing.normal), length(lift.back + lifted));
  const Vectors by_mirror =
      across(shorter(across(by_lifted, lifted), lifted_length), crossing.flat_normal);
  const Vectors bent = (lift.back * dot(by_mirror, crossing.straight_normal) +
                        by_mirror * dot(lift.back, crossing.straight_normal)) *
                       set(2.0F);
  return facing(crossing.leaving, if_then_else(lift.needed, bent, slope));
}

// The direction in which a smooth boundary lets light through, and the part of it that it reflects
// instead.
struct Transmission {
  Vectors direction;
  Floats reflected;
};

// In which directions paths go on.
struct BoundaryDraw {
  Vectors direction;
  Mask transmitted;  // to the other side
  Floats weight;     // of a delta; else 1, or 0 where there is no such way
};

// The same, with what is known of them.
struct BoundarySample {
  Vectors direction;
  Mask transmitted;                  // to the other side
  Floats weight;                     // value / pdf; 0: the light is absorbed
  Floats pdf;                        // per steradian; of a boundary that is a delta, 0
  Floats scores[kMaxBoundarySlots];  // see BoundaryValue
  // The weight of an edge (BoundaryEdge) behind the boundary over the probability that it is
  // followed, `weight` being 0; else 0. It is that of a derivative in the index, or, where that in
  // the normal is asked for, what multiplies `by_normal`.
  Floats edge_weight;
  Vectors by_normal;
};

// A direction where value ends and is not 0, drawn: its part of the derivatives, for light of
// radiance 1 from there, is the weight times how much the end turns by the index, or by the normal.
struct BoundaryEdge {
  Vectors direction;
  Floats weight, by_index;
  Vectors by_normal;
};

// What light from a direction brings.
struct BoundaryValue {
  Floats value;                      // that part of its radiance by steradian, the cosine included
  Floats pdf;                        // with which that direction is drawn, per steradian
  Floats scores[kMaxBoundarySlots];  // the derivatives of log value in the slots of the kind
  Vectors by_normal = set(Vec3f{});  // and in the normal
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
