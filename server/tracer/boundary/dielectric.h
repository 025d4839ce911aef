// A smooth surface between two transparent media, as that of polished marble or a still liquid:
// light is mirrored in part, the rest is refracted. No derivative is known in its index, which
// turns the directions of paths.
#ifndef ITN_TRACER_BOUNDARY_DIELECTRIC_H_
#define ITN_TRACER_BOUNDARY_DIELECTRIC_H_

namespace itn::tracer {

struct Dielectric {
  float index = 1.5F;  // of refraction, of the medium, relative to what is around it

  static constexpr const char* kName = "dielectric";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.number("index", self.index, 1, 2.5);
  }

  Dielectric compile() const { return *this; }

  static constexpr bool kStopsLines = true, kDelta = true;
  double relative_index() const { return double{index}; }
  double refraction_spread() const { return 0; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_BOUNDARY_DIELECTRIC_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_BOUNDARY_DIELECTRIC_MATHS_
#undef ITN_TRACER_BOUNDARY_DIELECTRIC_MATHS_
#else
#define ITN_TRACER_BOUNDARY_DIELECTRIC_MATHS_
#endif

#include "server/tracer/boundary/fresnel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Transmission transmit(const Dielectric& boundary, const Crossing& crossing) {
  const Floats cosine = hn::Max(hn::Zero(FloatTag()), -dot(crossing.direction, crossing.normal));
  const Floats index = index_ahead(boundary.index, crossing.leaving);
  const auto [reflected, refracted_cosine] = fresnel(cosine, index);
  return {refracted(crossing.direction, crossing.normal, cosine, refracted_cosine, index),
          reflected};
}

HWY_INLINE BoundaryDraw draw(const Dielectric& boundary, const Crossing& crossing,
                             const Words& words) {
  const auto [through, reflected] = transmit(boundary, crossing);
  const Mask transmitted = uniform(words.w[0]) >= reflected;
  return {if_then_else(transmitted, through, mirrored(crossing.direction, crossing.normal)),
          transmitted, set(1.0F)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
