// A film on the boundary that mirrors a part of the light, absorbs another, and lets the rest pass
// straight, whatever its direction. Closed forms are known of it, for tests: no scene of a request
// has it.
#ifndef ITN_TRACER_BOUNDARY_PARTIAL_MIRROR_H_
#define ITN_TRACER_BOUNDARY_PARTIAL_MIRROR_H_

namespace itn::tracer {

struct PartialMirror {
  float reflected = 0, absorbed = 0;  // parts of the light, together at most 1

  static constexpr const char* kName = "partial_mirror";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.number("reflected", self.reflected, 0, 1);
    to.number("absorbed", self.absorbed, 0, 1);
  }

  PartialMirror compile() const { return *this; }

  static constexpr bool kStopsLines = true, kDelta = true;
  double relative_index() const { return 1; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_BOUNDARY_PARTIAL_MIRROR_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_BOUNDARY_PARTIAL_MIRROR_MATHS_
#undef ITN_TRACER_BOUNDARY_PARTIAL_MIRROR_MATHS_
#else
#define ITN_TRACER_BOUNDARY_PARTIAL_MIRROR_MATHS_
#endif

#include "server/tracer/boundary/fresnel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE BoundaryDraw draw(const PartialMirror& film, const Crossing& crossing,
                             const Words& words) {
  const Floats u = uniform(words.w[0]);
  const Mask absorbed = u < film.absorbed;
  const Mask transmitted = u >= film.absorbed + film.reflected;
  return {
      if_then_else(transmitted, crossing.direction, mirrored(crossing.direction, crossing.normal)),
      transmitted, hn::IfThenElse(absorbed, hn::Zero(FloatTag()), set(1.0F))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
