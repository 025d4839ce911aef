// Derivatives in the places of lights, which rays to the lights' outlines bring
// (wavefront/walk/outline_rays-inl.h).
#if defined(ITN_TRACER_COLLECTED_LIGHT_PLACES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_LIGHT_PLACES_INL_H_
#undef ITN_TRACER_COLLECTED_LIGHT_PLACES_INL_H_
#else
#define ITN_TRACER_COLLECTED_LIGHT_PLACES_INL_H_
#endif

#include <array>
#include <cstddef>
#include <tuple>
#include <vector>

#include "common/fields.h"
#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/geometry/rays.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Rays that are sent to the outlines of lights (wavefront/walk/outline_rays-inl.h).
struct OutlineRays {
  Rays rays;
  UintColumn slot{};               // of the path
  std::vector<FloatColumn> light;  // as that of ShadowRays, for each of some derivatives
  size_t count = 0;
};

class LightPlaces {
 public:
  // A light that moves. The rays to its outline, on either side of it, and behind these to what
  // else is seen there, have the light for the derivatives with these numbers.
  struct Outlined {
    const Lights::Light& light;
    std::vector<size_t> places;
    std::array<OutlineRays, 4> rays;
  };

  LightPlaces(const Scene::Compiled& scene, const RenderRequest& request)
      : by_place_(derivatives_of(request, Parameter::kLightPlace)) {
    std::vector<size_t> lights;
    for (const size_t d : by_place_) {
      const Parameter& parameter = request.derivatives[d];
      const size_t slot = slots_of<LightDescription>()[parameter.slot].number;
      lights.push_back(parameter.index);
      axes_.push_back(scene.lights.described(parameter.index).axes[slot]);
    }
    collected_.resize(axes_.size());
    for (const Lights::Light& light : scene.lights.all()) {
      std::vector<size_t> places;
      for (size_t p = 0; p < lights.size(); ++p) {
        if (lights[p] == light.number) places.push_back(p);
      }
      if (places.empty()) continue;
      outlined_.push_back({light, places, {}});
      for (OutlineRays& rays : outlined_.back().rays) {
        rays.light.resize(places.size());
        rays.rays.bounded = scene.lights.has_near();
      }
    }
  }

  std::vector<Outlined>& outlined() { return outlined_; }
  // Along which a place moves its light.
  Vec3f axis(size_t place) const { return axes_[place]; }
  HWY_INLINE void add(const SlotGather& at, Floats light, size_t place) {
    at.add(light, collected_[place]);
  }

  auto columns() { return std::tie(collected_); }

  void record(size_t slot, float /*expected*/, PathEstimate& estimate) const {
    record_derivatives(by_place_, collected_, slot, estimate);
  }

 private:
  const std::vector<size_t> by_place_;  // which of the request's derivatives
  std::vector<Vec3f> axes_;
  std::vector<Outlined> outlined_;
  FloatStates<> collected_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
