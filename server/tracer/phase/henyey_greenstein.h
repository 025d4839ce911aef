// The Henyey-Greenstein phase function (Henyey, Greenstein, "Diffuse radiation in the galaxy",
// 1941). cos_theta is the cosine between the directions of propagation before and after the
// scattering, so that g > 0 scatters forward. Densities are per steradian.
#ifndef ITN_TRACER_PHASE_HENYEY_GREENSTEIN_H_
#define ITN_TRACER_PHASE_HENYEY_GREENSTEIN_H_

#include "common/material.h"

namespace itn::tracer {

struct HenyeyGreenstein {
  float g = 0;  // mean cosine

  static constexpr const char* kName = "";  // a field of the material itself
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("g", self.g, -kMaxAbsG, kMaxAbsG);
  }
  double mean_cosine() const { return double{g}; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_PHASE_HENYEY_GREENSTEIN_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_HENYEY_GREENSTEIN_MATHS_
#undef ITN_TRACER_PHASE_HENYEY_GREENSTEIN_MATHS_
#else
#define ITN_TRACER_PHASE_HENYEY_GREENSTEIN_MATHS_
#endif

#include <numbers>

#include "server/tracer/phase/phase_value-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// p(cos_theta) = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos_theta)^(3/2)). Taking the logarithm of p and
// differentiating term by term, the score is
//   -2 g / (1 - g^2) - 3 (g - cos_theta) / (1 + g^2 - 2 g cos_theta).
HWY_INLINE PhaseValue evaluate(const HenyeyGreenstein& phase, Floats cosine) {
  const float g = phase.g;
  const Floats per_q = 1 / (1 + g * g - 2 * g * cosine);
  const Floats norm = set((1 - g * g) * (0.25F * std::numbers::inv_pi_v<float>));
  const Floats score = -2 * g / (1 - g * g) - 3 * (g - cosine) * per_q;
  return {norm * per_q * hn::Sqrt(per_q), {score}};
}

// Draws cos_theta with density 2 pi p. The distribution function inverts to
//   cos_theta = [1 + g^2 - ((1 - g^2) / (1 + g x))^2] / (2 g),  x = 2 u - 1 in [-1, 1).
// Bringing both terms over (1 + g x)^2 makes the numerator divisible by 2 g; what is left has no
// cancellation at g = 0, where it is cos_theta = x:
//   cos_theta = [x + g (x^2 + 3) / 2 + g^2 x + g^3 (x^2 - 1) / 2] / (1 + g x)^2.
HWY_INLINE Floats sample_cosine(const HenyeyGreenstein& phase, Floats u) {
  const float g = phase.g;
  const Floats x = u + u - 1, x2 = x * x;
  const Floats denominator = mul_add(set(g), x, set(1.0F));
  const Floats linear = 0.5F * (x2 + 3);
  const Floats square = g * (x + g * 0.5F * (x2 - 1));
  const Floats numerator = mul_add(set(g), linear + square, x);
  return hn::Clamp(numerator / (denominator * denominator), set(-1.0F), set(1.0F));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
