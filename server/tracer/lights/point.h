// A lamp so small that it is a point, which shines alike in all directions.
#ifndef ITN_TRACER_LIGHTS_POINT_H_
#define ITN_TRACER_LIGHTS_POINT_H_

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"
#include "common/geometry/mesh.h"
#include "common/vec.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

struct PointLight {
  Vec3d position;        // outside of the medium
  double intensity = 1;  // W/sr
  // Once it is compiled: of what distance power() is the irradiance, squared, in mm^2. It is that
  // of the object's middle, as what a light gives the object decides how often it is drawn.
  double distance2 = 1;

  static constexpr const char* kName = "point";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.position("position", self.position);
    to.number("intensity", self.intensity, 0, 1e9);
  }
  PointLight compile(const LightFrame& frame) const {
    const Vec3d p = frame.pose.to_object(position);
    const Bounds box = frame.object.vertices.empty() ? Bounds() : bounds(frame.object);
    const auto low = static_cast<Vec3d>(box.min), high = static_cast<Vec3d>(box.max);
    const Vec3d to_middle = (low + high) * 0.5 - p, to_corner = (high - low) * 0.5;
    const bool in_box = std::abs(to_middle.x) <= to_corner.x &&
                        std::abs(to_middle.y) <= to_corner.y &&
                        std::abs(to_middle.z) <= to_corner.z;
    if (in_box && winding_number(frame.object, p) > 0.5) {
      throw invalid_input(fmt::format(
          "point.position is ({}, {}, {}), in the object; a lamp must stand outside of it",
          position.x, position.y, position.z));
    }
    return {p, intensity, std::max(dot(to_middle, to_middle), dot(to_corner, to_corner))};
  }

  static constexpr bool kDelta = true, kDistant = false;
  double power() const { return intensity * 1e6 / distance2; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_POINT_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_POINT_MATHS_
#undef ITN_TRACER_LIGHTS_POINT_MATHS_
#else
#define ITN_TRACER_LIGHTS_POINT_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Beam beam(const PointLight& light, Vectors from) {
  const Vectors to = set(static_cast<Vec3f>(light.position)) - from;
  const Floats d2 = hn::Max(dot(to, to), set(1e-20F)), distance = hn::Sqrt(d2);
  return {to * hn::Div(set(1.0F), distance), distance,
          hn::Div(set(static_cast<float>(light.distance2)), d2)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
