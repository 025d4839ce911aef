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
  // Whether a derivative in the index is asked for: what its score costs, and paths that follow
  // edges (BoundaryEdge).
  bool by_index;
};

// The normals on the outer side.
HWY_INLINE Crossing crossing_of(Vectors direction, Vectors outwards, Vectors flat_outwards,
                                Mask leaving, bool flat, bool by_index) {
  const Floats zero = hn::Zero(FloatTag());
  const auto facing = [&](Vectors n) {
    return if_then_else(leaving, Vectors{zero, zero, zero} - n, n);
  };
  const Vectors flat_normal = facing(flat_outwards);
  if (flat) return {direction, flat_normal, flat_normal, leaving, true, by_index};
  // Where a mirror would send light through the triangle, the normal is bent until it does not:
  // halfway between where the path comes from, and a direction that is just outside.
  const Vectors normal = facing(outwards), back = Vectors{zero, zero, zero} - direction;
  const Vectors mirror = normal * hn::Mul(set(2.0F), dot(back, normal)) - back;
  const Floats height = dot(mirror, flat_normal);
  const Floats arrival = hn::Max(dot(back, flat_normal), set(1e-6F));
  const Floats least = hn::Min(hn::Mul(set(0.9F), arrival), set(0.01F));
  const Vectors lifted = normalize(mirror + flat_normal * hn::Sub(least, height));
  const Vectors bent = normalize(back + lifted);
  const Mask through = hn::Or(hn::Lt(height, least), hn::Le(dot(back, normal), zero));
  return {direction, if_then_else(through, bent, normal), flat_normal, leaving, false, by_index};
}

// Where a smooth boundary lets light through to, and the part of it that it reflects instead.
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
  // Where an edge is followed (BoundaryEdge), which is behind the boundary: its weight over the
  // probability of that, `weight` being 0; else 0.
  Floats edge_weight;
};

// A direction where value ends and is not 0, drawn, and its part of the derivative in the slot that
// is the index by which this end turns, for light of radiance 1 from there.
struct BoundaryEdge {
  Vectors direction;
  Floats weight;
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
