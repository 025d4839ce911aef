// Derivatives in the reflectances of surfaces.
#if defined(ITN_TRACER_COLLECTED_REFLECTANCES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_REFLECTANCES_INL_H_
#undef ITN_TRACER_COLLECTED_REFLECTANCES_INL_H_
#else
#define ITN_TRACER_COLLECTED_REFLECTANCES_INL_H_
#endif

#include <cstddef>
#include <tuple>
#include <vector>

#include "common/fields.h"
#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/surfaces/reflectance.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Light that a path brings counts d W / d reflectance, by the product rule: that takes every factor
// of W, and W times the slope of the reflectance where the factor is that reflectance.
class Reflectances {
 public:
  Reflectances(const Scene::Compiled& scene, const RenderRequest& request)
      : derivatives_(derivatives_of(request, Parameter::kReflectance)) {
    for (const size_t d : derivatives_) {
      const Parameter& parameter = request.derivatives[d];
      asked_.push_back({scene.obstacles.surfaces.triangles_of(parameter.index),
                        scene.surfaces[parameter.index].reflectance,
                        slots_of<Reflectance>()[parameter.slot].number});
    }
    d_weight_.resize(asked_.size());
    collected_.resize(asked_.size());
  }

  auto columns() { return std::tie(d_weight_, collected_); }
  auto weights() { return std::tie(d_weight_); }

  HWY_INLINE void on_vertex(const AtVertex& vertex) {
    for (size_t r = 0; r < asked_.size(); ++r) {
      const auto& [triangles, reflectance, slot] = asked_[r];
      const Floats slope = reflectance_slope(reflectance, slot, vertex.position);
      const Floats gain =
          hn::IfThenElseZero(among(triangles, vertex.vertices.triangles), vertex.weight * slope);
      FloatColumn& column = d_weight_[r];
      store(mul_add(load(column, vertex.i), vertex.vertices.factor, gain), column, vertex.i);
    }
  }

  HWY_INLINE void on_light(const Light& light) {
    for (size_t r = 0; r < asked_.size(); ++r) {
      light.at.add(light.at.get(d_weight_[r]) * light.by_weight, collected_[r]);
    }
  }

  // The derivative of a dark surface comes from paths of a few reflections.
  HWY_INLINE Floats importance(Floats least, size_t i) const {
    constexpr float kPart = 0.25F;
    for (const FloatColumn& d_weight : d_weight_) {
      least = hn::Max(least, kPart * load(d_weight, i));
    }
    return least;
  }
  HWY_INLINE Floats throughput(Floats least, size_t i) const {
    for (const FloatColumn& d_weight : d_weight_) least = hn::Max(least, load(d_weight, i));
    return least;
  }

  void record(size_t slot, float /*expected*/, PathEstimate& estimate) const {
    record_derivatives(derivatives_, collected_, slot, estimate);
  }

 private:
  struct Asked {
    Surfaces::Range triangles;
    const Reflectance& reflectance;
    size_t slot;  // in the reflectance's kind
  };
  const std::vector<size_t> derivatives_;  // which of the request's
  std::vector<Asked> asked_;
  FloatStates<> d_weight_, collected_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
