// Images of media that have other albedos (RenderRequest::albedos): they share all paths, and each
// has weights of its own.
#if defined(ITN_TRACER_COLLECTED_ALBEDOS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_ALBEDOS_INL_H_
#undef ITN_TRACER_COLLECTED_ALBEDOS_INL_H_
#else
#define ITN_TRACER_COLLECTED_ALBEDOS_INL_H_
#endif

#include <cstddef>
#include <tuple>

#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

class Albedos {
 public:
  explicit Albedos(const RenderRequest& request) : request_(request) {
    weights_.resize(request.albedos.size());
    radiance_.resize(request.albedos.size());
  }

  auto columns() { return std::tie(weights_, radiance_); }
  auto weights() { return std::tie(weights_); }

  HWY_INLINE void on_vertex(const AtVertex& vertex) {
    for (size_t a = 0; a < weights_.size(); ++a) {
      const Floats albedo = set(static_cast<float>(request_.albedos[a]));
      const Floats factor = hn::IfThenElse(vertex.by_albedo, albedo, vertex.vertices.factor);
      store(load(weights_[a], vertex.i) * factor, weights_[a], vertex.i);
    }
  }

  HWY_INLINE void on_light(const Light& light) {
    for (size_t a = 0; a < weights_.size(); ++a) {
      light.at.add(light.at.get(weights_[a]) * light.by_weight, radiance_[a]);
    }
  }

  void record(size_t slot, float /*expected*/, PathEstimate& estimate) const {
    for (size_t a = 0; a < radiance_.size(); ++a) estimate.other_media[a] = radiance_[a][slot];
  }

 private:
  const RenderRequest& request_;
  FloatStates<1> weights_;
  FloatStates<> radiance_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
