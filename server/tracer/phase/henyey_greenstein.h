// The Henyey-Greenstein phase function (Henyey, Greenstein, "Diffuse radiation in the galaxy",
// 1941). cos_theta is the cosine between the directions of propagation before and after the
// scattering, so that g > 0 scatters forward. Densities are per steradian.
#ifndef ITN_TRACER_PHASE_HENYEY_GREENSTEIN_H_
#define ITN_TRACER_PHASE_HENYEY_GREENSTEIN_H_

namespace itn::tracer {

struct HenyeyGreenstein {
  float g = 0;  // mean cosine
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
template <typename F>
HWY_INLINE PhaseValue<F> evaluate(const HenyeyGreenstein& phase, F cos_theta) {
  const float g = phase.g;
  const F per_q = splat<F>(1) / (splat<F>(1 + g * g) - splat<F>(2 * g) * cos_theta);
  const F norm = splat<F>((1 - g * g) * (0.25F * std::numbers::inv_pi_v<float>));
  return {norm * per_q * square_root(per_q),
          splat<F>(-2 * g / (1 - g * g)) - splat<F>(3) * (splat<F>(g) - cos_theta) * per_q};
}

// Draws cos_theta with density 2 pi p. The distribution function inverts to
//   cos_theta = [1 + g^2 - ((1 - g^2) / (1 + g x))^2] / (2 g),  x = 2 u - 1 in [-1, 1).
// Bringing both terms over (1 + g x)^2 makes the numerator divisible by 2 g; what is left has no
// cancellation at g = 0, where it is cos_theta = x:
//   cos_theta = [x + g (x^2 + 3) / 2 + g^2 x + g^3 (x^2 - 1) / 2] / (1 + g x)^2.
template <typename F>
HWY_INLINE F sample_cosine(const HenyeyGreenstein& phase, F u) {
  const float g = phase.g;
  const F x = (u + u) - splat<F>(1), x2 = x * x;
  const F denominator = mul_add(splat<F>(g), x, splat<F>(1));
  const F linear = splat<F>(0.5F) * (x2 + splat<F>(3));
  const F square = splat<F>(g) * (x + splat<F>(g * 0.5F) * (x2 - splat<F>(1)));
  const F numerator = mul_add(splat<F>(g), linear + square, x);
  return clamp(numerator / (denominator * denominator), -1, 1);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
