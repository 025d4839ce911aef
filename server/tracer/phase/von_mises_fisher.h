// The distribution of von Mises and Fisher (Fisher, "Dispersion on a sphere", 1953), as a phase
// function without the long tails of Henyey and Greenstein's (Gkioulekas et al., "Understanding the
// role of phase function in translucent appearance", TOG 2013):
//   p = kappa exp(kappa cos_theta) / (4 pi sinh kappa).
#ifndef ITN_TRACER_PHASE_VON_MISES_FISHER_H_
#define ITN_TRACER_PHASE_VON_MISES_FISHER_H_

#include <cmath>

namespace itn::tracer {

struct VonMisesFisher {
  float kappa = 5;  // concentration; beyond 40, exp(-2 kappa) would leave what a float holds

  static constexpr const char* kName = "von_mises_fisher";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("kappa", self.kappa, 0.05, 40);
  }
  double mean_cosine() const { return 1 / std::tanh(double{kappa}) - 1 / double{kappa}; }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_PHASE_VON_MISES_FISHER_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_VON_MISES_FISHER_MATHS_
#undef ITN_TRACER_PHASE_VON_MISES_FISHER_MATHS_
#else
#define ITN_TRACER_PHASE_VON_MISES_FISHER_MATHS_
#endif

#include <numbers>

#include "server/tracer/phase/phase_value-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// With q = exp(-2 kappa), p = kappa exp(kappa (cos_theta - 1)) / (2 pi (1 - q)), in which nothing
// overflows. The score is cos_theta - coth kappa + 1 / kappa, coth kappa = (1 + q) / (1 - q).
HWY_INLINE PhaseValue evaluate(const VonMisesFisher& phase, Floats cosine) {
  const Floats kappa = set(phase.kappa), q = exp(set(-2 * phase.kappa));
  const Floats per_rest = 1 / (1 - q);
  const Floats norm = phase.kappa * 0.5F * std::numbers::inv_pi_v<float> * per_rest;
  const Floats mean = (1 + q) * per_rest - 1 / kappa;
  return {norm * exp(kappa * (cosine - 1)), {cosine - mean}};
}

// The distribution function inverts to cos_theta = 1 + ln(q + u (1 - q)) / kappa.
HWY_INLINE Floats sample_cosine(const VonMisesFisher& phase, Floats u) {
  const Floats one = set(1.0F), q = exp(set(-2 * phase.kappa));
  const Floats cosine = 1 + log(mul_add(u, 1 - q, q)) / phase.kappa;
  return hn::Clamp(cosine, set(-1.0F), one);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
