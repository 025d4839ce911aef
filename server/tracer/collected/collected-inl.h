// What paths collect beside their radiance. A kind of it is a class in a file of this folder, and
// an entry of the list below; events-inl.h, media-inl.h, vertices-inl.h and state_columns.h are
// what kinds and the walk share. All of its functions but columns() may be left out:
//
//   columns()                    the columns that begin and move with a path
//   weights()                    those of them that take every factor of a path's weight W, but for
//                                those of vertices
//   begin(slot), move(from, to)  what it knows of paths beside columns begins and moves
//   on_vertex(at)                takes the vertices' factors into its weights
//   on_flight(flight)            takes what a flight makes of scores
//   on_light(light)              collects light that arrives
//   importance(least, i)         what the paths are worth to it, or `least` if that is more: for
//                                the roulette (path_importance)
//   throughput(least, i)         the same for the roulette that other path tracers play
//   record(slot, expected, estimate)  writes what the path in a slot has collected; `expected` is
//                                the radiance of its pixel (PathSample), for control variates
#if defined(ITN_TRACER_COLLECTED_COLLECTED_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_COLLECTED_INL_H_
#undef ITN_TRACER_COLLECTED_COLLECTED_INL_H_
#else
#define ITN_TRACER_COLLECTED_COLLECTED_INL_H_
#endif

#include <cstddef>
#include <optional>

#include "server/tracer/collected/albedos-inl.h"
#include "server/tracer/collected/colours-inl.h"
#include "server/tracer/collected/light_places-inl.h"
#include "server/tracer/collected/light_scales-inl.h"
#include "server/tracer/collected/map_gradient-inl.h"
#include "server/tracer/collected/medium-inl.h"
#include "server/tracer/collected/normal_gradient.h"
#include "server/tracer/collected/reflectances-inl.h"
#include "server/tracer/collected/scattering_orders-inl.h"
#include "server/tracer/collected/scores-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

struct Collected {
  Collected(const Scene::Compiled& scene, const RenderRequest& request, FilmWriter& film)
      : medium(request),
        scores(scene, request),
        albedos(request),
        colours(scene, request, scores),
        reflectances(scene, request),
        light_scales(request),
        scattering_orders(request),
        light_places(scene, request),
        map_gradient(scene, request, film) {
    if (request.gradient_normals) normal_gradient.emplace(scene, film);
  }

  MediumDerivatives medium;
  Scores scores;
  Albedos albedos;
  Colours colours;
  Reflectances reflectances;
  LightScales light_scales;
  ScatteringOrders scattering_orders;
  LightPlaces light_places;
  MapGradient map_gradient;
  std::optional<NormalGradient> normal_gradient;

  // The list of those that have columns.
  template <typename Visit>
  static HWY_INLINE void for_each(auto& all, const Visit& visit) {
    visit(all.medium);
    visit(all.scores);
    visit(all.albedos);
    visit(all.colours);
    visit(all.reflectances);
    visit(all.light_scales);
    visit(all.scattering_orders);
    visit(all.light_places);
    if (all.normal_gradient) visit(*all.normal_gradient);
  }

  void begin(size_t slot) {
    for_each(*this, [&](auto& kind) {
      begin_columns(kind.columns(), slot);
      if constexpr (requires { kind.begin(slot); }) kind.begin(slot);
    });
  }
  void move(size_t from, size_t to) {
    for_each(*this, [&](auto& kind) {
      move_columns(kind.columns(), from, to);
      if constexpr (requires { kind.move(from, to); }) kind.move(from, to);
    });
  }
  void record(size_t slot, float expected, PathEstimate& estimate) {
    for_each(*this, [&](auto& kind) {
      if constexpr (requires { kind.record(slot, expected, estimate); }) {
        kind.record(slot, expected, estimate);
      }
    });
  }

  // Calls visit(column) for all weights.
  template <typename Visit>
  HWY_INLINE void for_each_weight(const Visit& visit) {
    for_each(*this, [&](auto& kind) {
      if constexpr (requires { kind.weights(); }) for_each_column(kind.weights(), visit);
    });
  }
  HWY_INLINE void on_vertex(const AtVertex& at) {
    for_each(*this, [&](auto& kind) {
      if constexpr (requires { kind.on_vertex(at); }) kind.on_vertex(at);
    });
  }
  HWY_INLINE void on_flight(const Flight& flight) {
    for_each(*this, [&](auto& kind) {
      if constexpr (requires { kind.on_flight(flight); }) kind.on_flight(flight);
    });
  }
  HWY_INLINE void on_light(const Light& light) {
    for_each(*this, [&](auto& kind) {
      if constexpr (requires { kind.on_light(light); }) kind.on_light(light);
    });
  }
  HWY_INLINE Floats importance(Floats least, size_t i) const {
    for_each(*this, [&](const auto& kind) {
      if constexpr (requires { kind.importance(least, i); }) least = kind.importance(least, i);
    });
    return least;
  }
  HWY_INLINE Floats throughput(Floats least, size_t i) const {
    for_each(*this, [&](const auto& kind) {
      if constexpr (requires { kind.throughput(least, i); }) least = kind.throughput(least, i);
    });
    return least;
  }
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
