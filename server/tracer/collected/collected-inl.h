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

// The columns of a kind begin and move with a path.
template <typename Kind>
concept HasColumns = requires(Kind& kind) {
  kind.columns();
};

// What else a kind may do.

// What it knows of paths beside columns begins in a slot.
template <typename Kind>
concept BeginsPaths = requires(Kind& kind, size_t slot) {
  kind.begin(slot);
};
// It moves from one slot to another.
template <typename Kind>
concept MovesPaths = requires(Kind& kind, size_t from, size_t to) {
  kind.move(from, to);
};
// It has columns that take every factor of a path's weight W, but for those of vertices.
template <typename Kind>
concept HasWeights = requires(Kind& kind) {
  kind.weights();
};
// It takes the vertices' factors into its weights.
template <typename Kind>
concept TakesVertices = requires(Kind& kind, const AtVertex& vertex) {
  kind.on_vertex(vertex);
};
// It takes what a flight makes of scores.
template <typename Kind>
concept TakesFlights = requires(Kind& kind, const Flight& flight) {
  kind.on_flight(flight);
};
// It collects light that arrives.
template <typename Kind>
concept CollectsLight = requires(Kind& kind, const Light& light) {
  kind.on_light(light);
};
// It says what the paths in slots i, i + 1 ... are worth to it, or `least` if that is more, for the
// roulette (path_importance).
template <typename Kind>
concept HasImportance = requires(const Kind& kind, Floats least, size_t i) {
  { kind.importance(least, i) } -> std::same_as<Floats>;
};
// It says the same for the roulette that other path tracers play.
template <typename Kind>
concept HasThroughput = requires(const Kind& kind, Floats least, size_t i) {
  { kind.throughput(least, i) } -> std::same_as<Floats>;
};
// It writes what the path in a slot has collected; `expected` is the radiance of its pixel
// (PathSample), for control variates.
template <typename Kind>
concept RecordsPaths = requires(Kind& kind, size_t slot, float expected, PathEstimate& estimate) {
  kind.record(slot, expected, estimate);
};

// A function that a kind has, and that does not take what it is given above, is refused, as it
// would never be called.
template <typename Kind>
concept CollectedKind = HasColumns<Kind> &&(BeginsPaths<Kind> || !requires { &Kind::begin; }) &&
                        (MovesPaths<Kind> || !requires { &Kind::move; }) &&
                        (HasWeights<Kind> || !requires { &Kind::weights; }) &&
                        (TakesVertices<Kind> || !requires { &Kind::on_vertex; }) &&
                        (TakesFlights<Kind> || !requires { &Kind::on_flight; }) &&
                        (CollectsLight<Kind> || !requires { &Kind::on_light; }) &&
                        (HasImportance<Kind> || !requires { &Kind::importance; }) &&
                        (HasThroughput<Kind> || !requires { &Kind::throughput; }) &&
                        (RecordsPaths<Kind> || !requires { &Kind::record; });

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
    for_each(*this, [&]<CollectedKind Kind>(Kind& kind) {
      begin_columns(kind.columns(), slot);
      if constexpr (BeginsPaths<Kind>) kind.begin(slot);
    });
  }
  void move(size_t from, size_t to) {
    for_each(*this, [&]<typename Kind>(Kind& kind) {
      move_columns(kind.columns(), from, to);
      if constexpr (MovesPaths<Kind>) kind.move(from, to);
    });
  }
  void record(size_t slot, float expected, PathEstimate& estimate) {
    for_each(*this, [&]<typename Kind>(Kind& kind) {
      if constexpr (RecordsPaths<Kind>) kind.record(slot, expected, estimate);
    });
  }

  // Calls visit(column) for all weights.
  template <typename Visit>
  HWY_INLINE void for_each_weight(const Visit& visit) {
    for_each(*this, [&]<typename Kind>(Kind& kind) {
      if constexpr (HasWeights<Kind>) for_each_column(kind.weights(), visit);
    });
  }
  HWY_INLINE void on_vertex(const AtVertex& vertex) {
    for_each(*this, [&]<typename Kind>(Kind& kind) {
      if constexpr (TakesVertices<Kind>) kind.on_vertex(vertex);
    });
  }
  HWY_INLINE void on_flight(const Flight& flight) {
    for_each(*this, [&]<typename Kind>(Kind& kind) {
      if constexpr (TakesFlights<Kind>) kind.on_flight(flight);
    });
  }
  HWY_INLINE void on_light(const Light& light) {
    for_each(*this, [&]<typename Kind>(Kind& kind) {
      if constexpr (CollectsLight<Kind>) kind.on_light(light);
    });
  }
  HWY_INLINE Floats importance(Floats least, size_t i) const {
    for_each(*this, [&]<typename Kind>(const Kind& kind) {
      if constexpr (HasImportance<Kind>) least = kind.importance(least, i);
    });
    return least;
  }
  HWY_INLINE Floats throughput(Floats least, size_t i) const {
    for_each(*this, [&]<typename Kind>(const Kind& kind) {
      if constexpr (HasThroughput<Kind>) least = kind.throughput(least, i);
    });
    return least;
  }
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
