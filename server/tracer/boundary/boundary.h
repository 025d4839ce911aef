// The list of boundaries of the medium. A kind is a file, as dielectric.h, an entry here, and a
// message in the Object of itn/v1/scene.proto. A kind has what BoundaryKind and BoundaryMaths list,
// and its fields (common/fields.h), of which at most kMaxBoundarySlots are slots; kIndexSlot is
// that of the index, if it has one.
//
// At a boundary that stops lines, a crossing is a vertex of the path. Shadow rays end there and
// bring nothing, as the straight line to the light is not a path of light: only from vertices
// outside are any sent, those at the boundary among them unless it is a delta. From scatterings
// inside, the wavefront sends some that are refracted. Only they compete with the walk for the
// light that it meets behind a delta. A light that is a delta is not seen through it: such a scene
// is refused.
//
// A path that crosses more than kMaxConsecutiveCrossings times in a row, without scattering or
// reflection by a surface in between, counts as trapped by rounding, and is dropped as leaked.
#include <concepts>
#include <cstdint>
#include <optional>
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

template <typename Kind>
concept BoundaryKind = requires(const Kind& kind) {
  // Whether it does anything; else a line runs through any number of entries and exits in one go.
  { Kind::kStopsLines } -> std::same_as<const bool&>;
  // Whether the directions that it draws have no density.
  { Kind::kDelta } -> std::same_as<const bool&>;
  // The medium's index of refraction, relative to what is around it.
  { kind.relative_index() } -> std::same_as<double>;
  // Itself with what it computes beforehand.
  { kind.compile() } -> std::same_as<Kind>;
};
// A kind that refracts says how wide light is inside that comes in on a line: the median angle in
// radians, roughly.
template <typename Kind>
concept Refracting = requires(const Kind& kind) {
  { kind.refraction_spread() } -> std::same_as<double>;
};

inline bool stops_lines(const Boundary& boundary) {
  return std::visit([](const BoundaryKind auto& kind) { return kind.kStopsLines; }, boundary);
}
inline bool is_delta(const Boundary& boundary) {
  return std::visit([](const auto& kind) { return kind.kDelta; }, boundary);
}
inline bool refracts(const Boundary& boundary) {
  return std::visit([]<typename Kind>(const Kind&) { return Refracting<Kind>; }, boundary);
}
inline double refraction_spread(const Boundary& boundary) {
  return std::visit(
      []<typename Kind>(const Kind& kind) -> double {
        if constexpr (Refracting<Kind>) return kind.refraction_spread();
        return 0;
      },
      boundary);
}
// Whether it is so smooth that small lights are found through its facets alone, or that they are
// found quicker so.
inline bool is_nearly_smooth(const Boundary& boundary) {
  constexpr double kMostSpread = 0.02;
  return refracts(boundary) && refraction_spread(boundary) < kMostSpread;
}
inline Boundary compile(const Boundary& boundary) {
  return std::visit([](const auto& kind) -> Boundary { return kind.compile(); }, boundary);
}
// The slot of the index of refraction, if there is one.
inline std::optional<size_t> index_slot(const Boundary& boundary) {
  return std::visit(
      []<typename Kind>(const Kind&) -> std::optional<size_t> {
        if constexpr (requires { Kind::kIndexSlot; }) return Kind::kIndexSlot;
        return std::nullopt;
      },
      boundary);
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

#include "server/tracer/boundary/fresnel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// What a kind computes, for many paths at a time.
template <typename Kind>
concept DrawnBoundary = requires(const Kind& kind, const Crossing& crossing, const Words& words) {
  // How paths go on.
  { draw(kind, crossing, words) } -> std::same_as<BoundaryDraw>;
};
template <typename Kind>
concept BoundaryWithDensity = requires(const Kind& kind, const Crossing& crossing, Vectors to) {
  // What light from a direction brings the paths, and the density with which `draw` takes it.
  { evaluate(kind, crossing, to) } -> std::same_as<BoundaryValue>;
};
template <typename Kind>
concept TransmittingDelta = requires(const Kind& kind, const Crossing& crossing) {
  // Where paths go that cross, without a draw.
  { transmit(kind, crossing) } -> std::same_as<Transmission>;
};
template <typename Kind>
concept BoundaryWithEdge = requires(const Kind& kind, const Crossing& crossing, Floats u) {
  // A direction, drawn by u, where the value ends and is not 0, for derivatives in index and
  // normal.
  { edge(kind, crossing, u) } -> std::same_as<BoundaryEdge>;
};
template <typename Kind>
concept BoundaryMaths = (!Kind::kStopsLines || DrawnBoundary<Kind>)&&(
    Kind::kDelta || BoundaryWithDensity<Kind>)&&(!Kind::kDelta || !Refracting<Kind> ||
                                                 TransmittingDelta<Kind>)&&(!requires {
  Kind::kIndexSlot;
} || BoundaryWithEdge<Kind>);

// By the normal that the crossing says, as if it were that of the triangle.
HWY_INLINE BoundaryValue evaluate_flat(const Boundary& boundary, const Crossing& crossing,
                                       Vectors to) {
  const Floats zero = hn::Zero(FloatTag());
  BoundaryValue result{zero, zero, {zero}};
  visit_kind(boundary, [&]<BoundaryMaths Kind>(const Kind& kind) {
    if constexpr (!Kind::kDelta) result = evaluate(kind, crossing, to);
  });
  return result;
}

// If triangles stand for a smooth surface, a direction that is reflected from the one side of the
// surface may be on the other side of the triangle. It is mirrored at the triangle then, and so is
// one that is refracted: no light is lost, and none leaks. So a direction has come about by
// itself, or as the mirror image of one, or both.

// Nothing of a boundary that is a delta.
HWY_INLINE BoundaryValue evaluate(const Boundary& boundary, const Crossing& crossing,
                                  Vectors direction) {
  if (crossing.flat) return evaluate_flat(boundary, crossing, direction);
  const Floats zero = hn::Zero(FloatTag());
  const Mask reflects = dot(direction, crossing.flat_normal) > 0;
  BoundaryValue sum{zero, zero, {zero}};
  for (const Vectors from : {direction, mirrored(direction, crossing.flat_normal)}) {
    const Mask same = !(reflects ^ (dot(from, crossing.normal) > 0));
    const BoundaryValue part = evaluate_flat(boundary, crossing, from);
    const Floats value = hn::IfThenElseZero(same, part.value);
    sum.value += value;
    sum.pdf += hn::IfThenElseZero(same, part.pdf);
    for (size_t s = 0; s < kMaxBoundarySlots; ++s) {
      sum.scores[s] = mul_add(value, part.scores[s], sum.scores[s]);
    }
    if (crossing.asked.normal) sum.by_normal = sum.by_normal + part.by_normal * value;
  }
  for (Floats& score : sum.scores) score /= hn::Max(sum.value, set(1e-20F));
  if (crossing.asked.normal) {
    sum.by_normal = sum.by_normal * (1 / hn::Max(sum.value, set(1e-20F)));
  }
  return sum;
}

// What such a boundary makes of a direction.
HWY_INLINE Vectors on_its_side(const Crossing& crossing, Vectors direction, Mask transmitted) {
  if (crossing.flat) return direction;
  const Mask reflects = dot(direction, crossing.flat_normal) > 0;
  return if_then_else(reflects ^ transmitted, direction, mirrored(direction, crossing.flat_normal));
}

// The transmission of a boundary that is a delta and refracts.
HWY_INLINE Transmission transmit(const Boundary& boundary, const Crossing& crossing) {
  Transmission through{crossing.direction, set(1.0F)};
  visit_kind(boundary, [&]<typename Kind>(const Kind& kind) {
    if constexpr (Kind::kDelta && Refracting<Kind>) through = transmit(kind, crossing);
  });
  through.direction = on_its_side(crossing, through.direction, hn::FirstN(FloatTag(), lanes()));
  return through;
}

// How often a path follows an edge, where derivatives are asked for that need it.
constexpr float kEdgeProbability = 0.1F;

// Follows edges instead of what was drawn, with that probability.
HWY_INLINE void follow_edges(const Boundary& boundary, const Crossing& crossing, const Words& words,
                             BoundarySample& next) {
  const Floats zero = hn::Zero(FloatTag());
  BoundaryEdge ending{next.direction, zero, zero, next.by_normal};
  visit_kind(boundary, [&]<typename Kind>(const Kind& kind) {
    if constexpr (requires { Kind::kIndexSlot; })
      ending = edge(kind, crossing, uniform(words.w[0]));
  });
  const Mask chosen = fifth_uniform(words) < kEdgeProbability;
  const Mask all = hn::FirstN(FloatTag(), lanes());
  next.direction =
      if_then_else(chosen, on_its_side(crossing, ending.direction, all), next.direction);
  next.transmitted |= chosen;
  next.weight = hn::IfThenZeroElse(chosen, next.weight * (1 / (1 - kEdgeProbability)));
  const Floats weight = crossing.asked.normal ? ending.weight : ending.weight * ending.by_index;
  next.edge_weight = hn::IfThenElseZero(chosen, weight * (1 / kEdgeProbability));
  next.by_normal = if_then_else(chosen, ending.by_normal, next.by_normal);
}

// Draws a direction at a boundary that stops lines.
HWY_INLINE BoundarySample sample(const Boundary& boundary, const Crossing& crossing,
                                 const Words& words) {
  const Floats zero = hn::Zero(FloatTag());
  BoundaryDraw drawn{crossing.direction, hn::FirstN(FloatTag(), 0), zero};
  visit_kind(boundary, [&]<typename Kind>(const Kind& kind) {
    if constexpr (Kind::kStopsLines) drawn = draw(kind, crossing, words);
  });
  const Vectors direction = on_its_side(crossing, drawn.direction, drawn.transmitted);
  if (is_delta(boundary)) {
    return {direction, drawn.transmitted, drawn.weight, zero, {zero}, zero, set(Vec3f{})};
  }
  const BoundaryValue value = evaluate(boundary, crossing, direction);
  const Mask possible = (drawn.weight > 0) & (value.pdf > 0);
  const Floats pdf = hn::Max(value.pdf, set(1e-20F));
  BoundarySample next{
      direction, drawn.transmitted, hn::IfThenElseZero(possible, value.value / pdf), pdf, {zero},
      zero,      value.by_normal};
  for (size_t s = 0; s < kMaxBoundarySlots; ++s) next.scores[s] = value.scores[s];
  if (crossing.asked.any()) follow_edges(boundary, crossing, words, next);
  return next;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
