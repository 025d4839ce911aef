// The list of boundaries of the medium. A kind is a file, as dielectric.h, an entry here, and a
// message in the Object of itn/v1/scene.proto. It says its fields (common/fields.h), of which at
// most kMaxBoundarySlots are slots, and
//   kStopsLines       whether it does anything; else a line runs through any number of entries and
//                     exits in one go
//   kDelta            whether the directions that it draws have no density
//   relative_index()  of refraction, of the medium, relative to what is around it
//   compile()         itself with what it computes beforehand
// and computes, for many paths at a time (boundary/crossing-inl.h),
//   sample(kind, crossing, words)     how they go on
//   evaluate(kind, crossing, to)      unless it is a delta: what light from a direction brings them
//
// At a boundary that stops lines, a crossing is a vertex of the path. Shadow rays end there and
// bring nothing, as the straight line to the light is not a path of light: only from vertices
// outside are any sent, those at the boundary among them unless it is a delta. Behind a delta
// nothing competes with the walk for the light that it meets, and no weight of multiple importance
// sampling applies. A light that is a delta is not seen through it: such a scene is refused.
//
// A path that crosses more than kMaxConsecutiveCrossings times in a row, without scattering or
// reflection by a surface in between, counts as trapped by rounding, and is dropped as leaked.
#include <cstdint>
#include <variant>

#include "server/tracer/boundary/dielectric.h"
#include "server/tracer/boundary/index_matched.h"
#include "server/tracer/boundary/partial_mirror.h"
#include "server/tracer/boundary/rough_dielectric.h"
#include "server/tracer/boundary/slots.h"

#ifndef ITN_TRACER_BOUNDARY_BOUNDARY_H_
#define ITN_TRACER_BOUNDARY_BOUNDARY_H_

namespace itn::tracer {

using Boundary = std::variant<IndexMatched, PartialMirror, Dielectric, RoughDielectric>;

constexpr uint32_t kMaxConsecutiveCrossings = 1000000;

inline bool stops_lines(const Boundary& boundary) {
  return std::visit([](const auto& kind) { return kind.kStopsLines; }, boundary);
}
inline bool is_delta(const Boundary& boundary) {
  return std::visit([](const auto& kind) { return kind.kDelta; }, boundary);
}
inline Boundary compile(const Boundary& boundary) {
  return std::visit([](const auto& kind) -> Boundary { return kind.compile(); }, boundary);
}
inline double relative_index(const Boundary& boundary) {
  return std::visit([](const auto& kind) { return kind.relative_index(); }, boundary);
}

}  // namespace itn::tracer

#endif

#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_BOUNDARY_BOUNDARY_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_BOUNDARY_BOUNDARY_MATHS_
#undef ITN_TRACER_BOUNDARY_BOUNDARY_MATHS_
#else
#define ITN_TRACER_BOUNDARY_BOUNDARY_MATHS_
#endif

#include "server/tracer/boundary/crossing-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Of a boundary that stops lines.
HWY_INLINE BoundarySample sample(const Boundary& boundary, const Crossing& at, const Words& words) {
  const Floats zero = hn::Zero(FloatTag());
  BoundarySample result{at.direction, hn::FirstN(FloatTag(), 0), zero, zero, {zero}};
  visit_kind(boundary, [&]<typename Kind>(const Kind& kind) {
    if constexpr (Kind::kStopsLines) result = sample(kind, at, words);
  });
  return result;
}

// Nothing of one that is a delta.
HWY_INLINE BoundaryValue evaluate(const Boundary& boundary, const Crossing& at, Vectors to) {
  const Floats zero = hn::Zero(FloatTag());
  BoundaryValue result{zero, zero, {zero}};
  visit_kind(boundary, [&]<typename Kind>(const Kind& kind) {
    if constexpr (!Kind::kDelta) result = evaluate(kind, at, to);
  });
  return result;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
