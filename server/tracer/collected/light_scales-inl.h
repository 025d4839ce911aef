// Derivatives in the scales of lights.
#if defined(ITN_TRACER_COLLECTED_LIGHT_SCALES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_LIGHT_SCALES_INL_H_
#undef ITN_TRACER_COLLECTED_LIGHT_SCALES_INL_H_
#else
#define ITN_TRACER_COLLECTED_LIGHT_SCALES_INL_H_
#endif

#include <cstddef>
#include <tuple>
#include <vector>

#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The radiance is linear in the scale of a light: its derivative is the part of it that the light
// sends.
class LightScales {
 public:
  explicit LightScales(const RenderRequest& request)
      : by_scale_(derivatives_of(request, Parameter::kLightScale)) {
    for (const size_t d : by_scale_) lights_.push_back(request.derivatives[d].index);
    collected_.resize(lights_.size());
  }

  // The numbers of the lights, in the order of LightParts.
  const std::vector<size_t>& lights() const { return lights_; }

  auto columns() { return std::tie(collected_); }

  HWY_INLINE void on_light(const Light& light) {
    for (size_t l = 0; l < lights_.size(); ++l) {
      light.at.add(light.contribution * light.parts.of[l], collected_[l]);
    }
  }

  void record(size_t slot, float /*expected*/, PathEstimate& estimate) const {
    record_derivatives(by_scale_, collected_, slot, estimate);
  }

 private:
  const std::vector<size_t> by_scale_;  // which of the request's derivatives
  std::vector<size_t> lights_;
  FloatStates<> collected_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
