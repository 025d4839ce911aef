// Two Henyey-Greenstein phase functions in one, as a rule a forward and a backward one (Kattawar,
// "A three-parameter analytic phase function for multiple scattering calculations", 1975):
//   p = weight p(g_1) + (1 - weight) p(g_2).
#ifndef ITN_TRACER_PHASE_TWO_TERM_H_
#define ITN_TRACER_PHASE_TWO_TERM_H_

#include <algorithm>

#include "common/material.h"
#include "server/tracer/phase/henyey_greenstein.h"

namespace itn::tracer {

struct TwoTerm {
  float g_1 = 0.8F, g_2 = -0.3F;  // mean cosines
  float weight = 0.9F;            // of the first

  static constexpr const char* kName = "two_term";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("g_1", self.g_1, -kMaxAbsG, kMaxAbsG);
    to.slot("g_2", self.g_2, -kMaxAbsG, kMaxAbsG);
    to.slot("weight", self.weight, 0, 1);
  }
  double mean_cosine() const {
    return double{weight} * double{g_1} + (1 - double{weight}) * double{g_2};
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_PHASE_TWO_TERM_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_PHASE_TWO_TERM_MATHS_
#undef ITN_TRACER_PHASE_TWO_TERM_MATHS_
#else
#define ITN_TRACER_PHASE_TWO_TERM_MATHS_
#endif

#include "server/tracer/phase/phase_value-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The logarithm of p has the derivatives weight p_1 s_1 / p, (1 - weight) p_2 s_2 / p and
// (p_1 - p_2) / p, where s_1 and s_2 are those of the logarithms of p_1 and p_2.
HWY_INLINE PhaseValue evaluate(const TwoTerm& phase, Floats cosine) {
  const PhaseValue first = evaluate(HenyeyGreenstein{phase.g_1}, cosine);
  const PhaseValue second = evaluate(HenyeyGreenstein{phase.g_2}, cosine);
  const Floats by_first = phase.weight * first.value;
  const Floats by_second = (1 - phase.weight) * second.value;
  const Floats value = by_first + by_second, per_value = 1 / value;
  return {value,
          {by_first * per_value * first.scores[0], by_second * per_value * second.scores[0],
           (first.value - second.value) * per_value}};
}

// What is left of u, once the term is chosen, is uniform again.
HWY_INLINE Floats sample_cosine(const TwoTerm& phase, Floats u) {
  const Floats weight = set(phase.weight), largest = set(1 - 0x1p-24F);
  const float tiny = 1e-30F;
  const Floats of_first = hn::Min(largest, u / std::max(phase.weight, tiny));
  const Floats of_second = hn::Min(largest, (u - weight) / std::max(1 - phase.weight, tiny));
  return hn::IfThenElse(u < weight, sample_cosine(HenyeyGreenstein{phase.g_1}, of_first),
                        sample_cosine(HenyeyGreenstein{phase.g_2}, of_second));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
