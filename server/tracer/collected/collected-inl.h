// What paths collect beside their radiance. A kind of it is a class in a file of this folder, and
// an entry of the list below, and has what CollectedKind lists; events-inl.h, media-inl.h,
// vertices-inl.h and state_columns.h are what kinds and the walk share.
#if defined(ITN_TRACER_COLLECTED_COLLECTED_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_COLLECTED_INL_H_
#undef ITN_TRACER_COLLECTED_COLLECTED_INL_H_
#else
#define ITN_TRACER_COLLECTED_COLLECTED_INL_H_
#endif

#include <concepts>
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

// All functions but columns() may be left out. One that a kind has, and that does not take what it
// is given here, is refused, as it would never be called.
template <typename Kind>
concept CollectedKind =
    // The columns that begin and move with a path.
    requires(Kind& kind) {
  kind.columns();
}
&&
    // What it knows of paths beside columns begins in a slot, and moves from one to another.
    (
        !requires { &Kind::begin; } || requires(Kind & kind, size_t slot) { kind.begin(slot); }) &&
    (
        !requires { &Kind::move; } ||
        requires(Kind & kind, size_t from) { kind.move(from, from); }) &&
    // Those columns that take every factor of a path's weight W, but for those of vertices.
    (
        !requires { &Kind::weights; } || requires(Kind & kind) { kind.weights(); }) &&
    // Takes the vertices' factors into its weights.
    (
        !requires { &Kind::on_vertex; } ||
        requires(Kind & kind, const AtVertex& at) { kind.on_vertex(at); }) &&
    // Takes what a flight makes of scores.
    (
        !requires { &Kind::on_flight; } ||
        requires(Kind & kind, const Flight& flight) { kind.on_flight(flight); }) &&
    // Collects light that arrives.
    (
        !requires { &Kind::on_light; } ||
        requires(Kind & kind, const Light& light) { kind.on_light(light); }) &&
    // What the paths in slots i, i + 1 ... are worth to it, or `least` if that is more: for the
    // roulette (path_importance), and for the one that other path tracers play.
    (
        !requires { &Kind::importance; } ||
        requires(const Kind& kind, Floats least, size_t i) {
          { kind.importance(least, i) } -> std::same_as<Floats>;
        }) &&
    (
        !requires { &Kind::throughput; } ||
        requires(const Kind& kind, Floats least, size_t i) {
          { kind.throughput(least, i) } -> std::same_as<Floats>;
        }) &&
    // Writes what the path in a slot has collected; `expected` is the radiance of its pixel
    // (PathSample), for control variates.
    (
        !requires { &Kind::record; } ||
        requires(Kind & kind, size_t slot, float expected, PathEstimate& estimate) {
          kind.record(slot, expected, estimate);
        });

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
    for_each(*this, [&](CollectedKind auto& kind) {
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
