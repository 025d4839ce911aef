// The parts of the radiance by how often the object's medium has scattered the light.
#if defined(ITN_TRACER_COLLECTED_SCATTERING_ORDERS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_SCATTERING_ORDERS_INL_H_
#undef ITN_TRACER_COLLECTED_SCATTERING_ORDERS_INL_H_
#else
#define ITN_TRACER_COLLECTED_SCATTERING_ORDERS_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The radiance is linear in the scale of what was scattered K times: its derivative is that part.
class ScatteringOrders {
 public:
  explicit ScatteringOrders(const RenderRequest& request)
      : derivatives_(derivatives_of(request, Parameter::kScattered)) {
    for (const size_t d : derivatives_) orders_.push_back(request.derivatives[d].index);
    count_.resize(orders_.empty() ? 0 : 1);
    collected_.resize(orders_.size());
  }

  auto columns() { return std::tie(count_, collected_); }

  HWY_INLINE void on_flight(const Flight& flight) {
    for (UintColumn& count : count_) {
      const Mask scattered = in_object(flight.media, flight.medium, flight.scattered);
      const Uints one = hn::IfThenElseZero(for_uints(scattered), set(uint32_t{1}));
      store(load(count, flight.i) + one, count, flight.i);
    }
  }

  HWY_INLINE void on_light(const Light& light) {
    for (size_t o = 0; o < orders_.size(); ++o) {
      const Mask is_of_order = equals(light.at.get(count_[0]), orders_[o]);
      light.at.add(hn::IfThenElseZero(is_of_order, light.contribution), collected_[o]);
    }
  }

  void record(size_t slot, float /*expected*/, PathEstimate& estimate) const {
    record_derivatives(derivatives_, collected_, slot, estimate);
  }

 private:
  const std::vector<size_t> derivatives_;  // which of the request's
  std::vector<uint32_t> orders_;
  UintStates count_;  // of scatterings so far
  FloatStates<> collected_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
