// Derivatives in sigma_t and albedo of the object's medium.
#if defined(ITN_TRACER_COLLECTED_MEDIUM_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_MEDIUM_INL_H_
#undef ITN_TRACER_COLLECTED_MEDIUM_INL_H_
#else
#define ITN_TRACER_COLLECTED_MEDIUM_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <tuple>
#include <vector>

#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Whether derivatives in the medium are asked for; all of it are computed then.
inline bool asks_for_medium(const RenderRequest& request) {
  return std::any_of(request.derivatives.begin(), request.derivatives.end(),
                     [](const Parameter& p) { return p.of_medium(); });
}

// Light counts d W / d albedo, by the product rule, and W times the score in sigma_t of all flights
// up to there.
//
// The score of a free flight, s = [1/sigma_t if it ended in a scattering] - length inside, has
// the expectation 0 whatever came before. So has the sum of s W over the flights, W being the
// weight before each: subtracting any multiple of it from the derivative keeps it unbiased. As
// the light that a path finds after a flight is about W times what it finds from the camera, the
// pixel's value is the multiple that takes away most of the noise (a control variate: Williams,
// "Simple statistical gradient-following algorithms", 1992).
class MediumDerivatives {
 public:
  explicit MediumDerivatives(const RenderRequest& request)
      : asked_(asks_for_medium(request)),
        per_sigma_t_(1 / static_cast<float>(request.material.sigma_t)) {
    if (!request.colours.empty()) return;
    by_sigma_t_ = derivatives_of(request, Parameter::kSigmaT);
    by_albedo_ = derivatives_of(request, Parameter::kAlbedo);
  }

  auto columns() { return std::tie(d_weight_, score_, d_sigma_t_, d_albedo_, control_); }
  auto weights() { return std::tie(d_weight_); }

  HWY_INLINE void on_flight(const Flight& flight) {
    if (!asked_) return;
    const size_t i = flight.i;
    Floats score = hn::IfThenElseZero(flight.scattered, set(per_sigma_t_)) - flight.length;
    score = of_object(flight.media, flight.medium, score);
    store(load(score_, i) + score, score_, i);
    store(mul_add(score, flight.weight, load(control_, i)), control_, i);
  }

  HWY_INLINE void on_vertex(const AtVertex& vertex) {
    if (!asked_) return;
    const Floats gain = hn::IfThenElseZero(vertex.by_albedo, vertex.weight);
    store(load(d_weight_, vertex.i) * vertex.vertices.factor + gain, d_weight_, vertex.i);
  }

  HWY_INLINE void on_light(const Light& light) {
    if (!asked_) return;
    const SlotGather& at = light.at;
    at.add(light.contribution * (at.get(score_) - light.length), d_sigma_t_);
    at.add(at.get(d_weight_) * light.by_weight, d_albedo_);
  }

  // In thick media of high albedo the derivative comes from long paths, whose W is small but whose
  // d W / d albedo is not.
  HWY_INLINE Floats importance(Floats least, size_t i) const {
    constexpr float kPart = 0.05F;
    return asked_ ? hn::Max(least, kPart * load(d_weight_, i)) : least;
  }

  void record(size_t slot, float expected, PathEstimate& estimate) const {
    for (const size_t d : by_sigma_t_) {
      estimate.derivatives[d] = d_sigma_t_[slot] - expected * control_[slot];
    }
    for (const size_t d : by_albedo_) estimate.derivatives[d] = d_albedo_[slot];
  }

 private:
  const bool asked_;
  const float per_sigma_t_;
  std::vector<size_t> by_sigma_t_, by_albedo_;  // which of the request's derivatives
  FloatState<> d_weight_{}, score_{};           // d W / d albedo; in mm
  FloatState<> d_sigma_t_{}, d_albedo_{}, control_{};
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
