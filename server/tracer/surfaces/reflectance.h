// The list of reflectances of surfaces. A kind is a file, as checkerboard.h, an entry here, and a
// message in the Surface of itn/v1/scene.proto. A kind has what ReflectanceKind and
// ReflectanceMaths list, its fields (common/fields.h), and memory(), in bytes, if it holds
// something elsewhere.
#include <concepts>
#include <variant>

#include "server/tracer/surfaces/checkerboard.h"
#include "server/tracer/surfaces/color_reflectance.h"
#include "server/tracer/surfaces/image_reflectance.h"
#include "server/tracer/surfaces/uniform_reflectance.h"

#ifndef ITN_TRACER_SURFACES_REFLECTANCE_H_
#define ITN_TRACER_SURFACES_REFLECTANCE_H_

namespace itn::tracer {

using Reflectance =
    std::variant<UniformReflectance, Checkerboard, ImageReflectance, ColorReflectance>;

template <typename Kind>
concept ReflectanceKind = requires(const Kind& kind, const Pose& pose, Channel channel) {
  // Itself in the coordinates of the object, for a film's channel.
  { kind.compile(pose, channel) } -> std::same_as<Kind>;
};

inline size_t memory_of(const Reflectance& reflectance) {
  return std::visit(
      [](const ReflectanceKind auto& kind) -> size_t {
        if constexpr (requires { kind.memory(); }) return kind.memory();
        return 0;
      },
      reflectance);
}

}  // namespace itn::tracer

#endif

#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_SURFACES_REFLECTANCE_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SURFACES_REFLECTANCE_MATHS_
#undef ITN_TRACER_SURFACES_REFLECTANCE_MATHS_
#else
#define ITN_TRACER_SURFACES_REFLECTANCE_MATHS_
#endif

#include "server/tracer/simd/kinds-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// What a kind computes, at many points of surfaces at a time, in mm.
template <typename Kind>
concept ReflectanceMaths = requires(const Kind& kind, size_t slot, Vectors p) {
  { reflectance_at(kind, p) } -> std::same_as<Floats>;
  // The derivative of that in one of its slots.
  { reflectance_slope(kind, slot, p) } -> std::same_as<Floats>;
};

HWY_INLINE Floats reflectance_at(const Reflectance& reflectance, Vectors p) {
  Floats result = hn::Zero(FloatTag());
  visit_kind(reflectance,
             [&](const ReflectanceMaths auto& kind) { result = reflectance_at(kind, p); });
  return result;
}
HWY_INLINE Floats reflectance_slope(const Reflectance& reflectance, size_t slot, Vectors p) {
  Floats result = hn::Zero(FloatTag());
  visit_kind(reflectance, [&](const auto& kind) { result = reflectance_slope(kind, slot, p); });
  return result;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
