// The images of red, green and blue (RenderRequest::colours), which share all paths, and their
// derivatives.
//
// The density of a path is, in each colour, a product of the same factors, but for its flights:
// with n scatterings and the length L in the medium, sigma_t^n exp(-sigma_t L). Of all paths, a
// third flies by each. By the balance heuristic, light that arrives along a path counts as if it
// had been drawn with the mean of the three densities, whichever it flew by: W times the density in
// the colour over that mean, the likelihood, which is 3 at most.
//
// Wilkie, Nawaz, Droske, Weidlich, Hanika, "Hero wavelength spectral sampling", EGSR 2014.
#if defined(ITN_TRACER_COLLECTED_COLOURS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_COLOURS_INL_H_
#undef ITN_TRACER_COLLECTED_COLOURS_INL_H_
#else
#define ITN_TRACER_COLLECTED_COLOURS_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <optional>
#include <tuple>
#include <vector>

#include "common/fields.h"
#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/medium-inl.h"
#include "server/tracer/collected/scores-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/colour/channel.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/surfaces/reflectance.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

class Colours {
 public:
  Colours(const Scene::Compiled& scene, const RenderRequest& request, const Scores& scores)
      : scene_(scene),
        least_sigma_t_(static_cast<float>(request.material.sigma_t)),
        asks_for_medium_(asks_for_medium(request)),
        scores_(scores.count()),
        phase_scores_(scores.phase_count()),
        index_score_(scores.index_score()) {
    for (const Material& colour : request.colours) {
      media_.push_back({static_cast<float>(colour.sigma_t), static_cast<float>(colour.albedo)});
    }
    for (auto* columns : {&weight_, &likelihood_}) columns->resize(size());
    for (auto* columns : {&d_weight_, &score_, &radiance_}) columns->resize(size());
    edge_.resize(index_score_ ? size() : 0);
    derivatives_.resize(size() * (2 + scores_));
    flight_sigma_t_.resize(asked() ? 1 : 0);
    for (const Parameter& parameter : request.derivatives) asked_.push_back(column_of(parameter));
  }

  size_t size() const { return media_.size(); }
  bool asked() const { return size() > 0; }
  float sigma_t(size_t colour) const { return media_[colour].sigma_t; }

  auto columns() {
    return std::tie(weight_, d_weight_, edge_, likelihood_, score_, radiance_, derivatives_,
                    flight_sigma_t_);
  }
  auto weights() { return std::tie(weight_, d_weight_, edge_); }

  // Chooses the colour by which a path flies; the random number is one of its first flight again.
  void choose(size_t slot, float& number) {
    const float place = number * static_cast<float>(size());
    const size_t colour = std::min(static_cast<size_t>(place), size() - 1);
    flight_sigma_t_[0][slot] = media_[colour].sigma_t;
    number = place - static_cast<float>(colour);
  }
  HWY_INLINE Floats flight_sigma_t(size_t i) const { return load(flight_sigma_t_[0], i); }

  // What flights add to likelihoods and to scores.
  HWY_INLINE void on_flight(const Flight& flight) {
    if (!asked()) return;
    const size_t i = flight.i;
    Floats sum = hn::Zero(FloatTag());
    for (size_t c = 0; c < size(); ++c) {
      // Over what it is at the least sigma_t, which is the material's: exp does not overflow.
      const float sigma_t = media_[c].sigma_t;
      const Floats flown = exp(flight.length * (least_sigma_t_ - sigma_t));
      const Floats ended =
          hn::IfThenElse(flight.scattered, set(sigma_t / least_sigma_t_), set(1.0F));
      const Floats likelihood = load(likelihood_[c], i) * (flown * ended);
      store(likelihood, likelihood_[c], i);
      sum += likelihood;
      if (!asks_for_medium_) continue;
      const Floats score = hn::IfThenElseZero(flight.scattered, set(1 / sigma_t)) - flight.length;
      store(load(score_[c], i) + score, score_[c], i);
    }
    const Floats by = static_cast<float>(size()) / sum;
    for (FloatColumn& likelihood : likelihood_) store(load(likelihood, i) * by, likelihood, i);
  }

  // In each colour, W takes the albedo or the reflectance that is of this colour.
  HWY_INLINE void on_vertex(const AtVertex& vertex) {
    const size_t i = vertex.i;
    const Vertices& vertices = vertex.vertices;
    for (size_t c = 0; c < size(); ++c) {
      Floats factor = hn::IfThenElse(vertices.in_medium, set(media_[c].albedo), vertices.factor);
      for (const Surfaces::Pattern& pattern : scene_.obstacles.surfaces.patterned) {
        factor = hn::IfThenElse(
            among(pattern.triangles, vertices.triangles),
            reflectance_at(scene_.colour_reflectances[c][pattern.surface], vertex.position),
            factor);
      }
      const Floats weight = load(weight_[c], i);
      store(weight * factor, weight_[c], i);
      if (asks_for_medium_) {
        const Floats gain = hn::IfThenElseZero(vertices.in_medium, weight);
        store(mul_add(load(d_weight_[c], i), factor, gain), d_weight_[c], i);
      }
      if (!edge_.empty()) store(load(edge_[c], i) * factor, edge_[c], i);
    }
  }

  // What light at the end of a path counts, in the mean of the colours.
  HWY_INLINE Floats mean_weight(size_t i) const {
    Floats sum = hn::Zero(FloatTag());
    for (size_t c = 0; c < size(); ++c) {
      sum = mul_add(load(weight_[c], i), load(likelihood_[c], i), sum);
    }
    return sum * (1 / static_cast<float>(size()));
  }

  // Calls visit(c, weight, edge) for each colour where edges are followed.
  template <typename Visit>
  HWY_INLINE void for_each_edge(const Visit& visit) {
    for (size_t c = 0; c < edge_.size(); ++c) visit(c, weight_[c], edge_[c]);
  }

  // `light(c)` arrives in colour c after this `length` in the medium, by which it is dimmed
  // already. Returns the luminance of what is collected.
  template <typename LightIn>
  HWY_INLINE Floats add(const SlotGather& path, Floats length, const LightIn& light,
                        const PathScores& scores) {
    Floats luminance = hn::Zero(FloatTag());
    for (size_t c = 0; c < size(); ++c) {
      const Floats likely_light = light(c) * path.get(likelihood_[c]);
      const Floats contribution = path.get(weight_[c]) * likely_light;
      path.add(contribution, radiance_[c]);
      luminance = mul_add(contribution, set(static_cast<float>(kLuminanceOfColours[c])), luminance);
      FloatColumn* const derivatives = &derivatives_[c * (2 + scores_)];
      if (asks_for_medium_) {
        path.add(contribution * (path.get(score_[c]) - length), derivatives[0]);
        path.add(path.get(d_weight_[c]) * likely_light, derivatives[1]);
      }
      for (size_t s = 0; s < scores_; ++s) {
        path.add(contribution * scores.of[s], derivatives[2 + s]);
      }
      if (edge_.empty()) continue;
      path.add(path.get(edge_[c]) * likely_light, derivatives[2 + *index_score_]);
    }
    return luminance;
  }

  void record(size_t slot, float /*expected*/, PathEstimate& estimate) const {
    for (size_t c = 0; c < size(); ++c) {
      estimate.other_media[c] = radiance_[c][slot];
      for (size_t d = 0; d < asked_.size(); ++d) {
        estimate.derivatives[d * size() + c] = derivatives_[c * (2 + scores_) + asked_[d]][slot];
      }
    }
  }

 private:
  struct Medium {
    float sigma_t, albedo;
  };
  // Among the derivatives of a colour.
  size_t column_of(const Parameter& parameter) const {
    switch (parameter.kind) {
      case Parameter::kAlbedo: return 1;
      case Parameter::kPhase: return 2 + slots_of<PhaseFunction>()[parameter.slot].number;
      case Parameter::kBoundary:
        return 2 + phase_scores_ + slots_of<Boundary>()[parameter.slot].number;
      default: return 0;
    }
  }

  const Scene::Compiled& scene_;
  const float least_sigma_t_;
  const bool asks_for_medium_;
  const size_t scores_, phase_scores_;
  const std::optional<size_t> index_score_;
  std::vector<Medium> media_;
  std::vector<size_t> asked_;  // columns of the request's derivatives
  // By colour: W, d W / d albedo, and what edges weigh beside W; the likelihood; the score in
  // sigma_t; what is collected, and its derivatives in sigma_t, albedo and by Scores, those of a
  // colour one after the other. And the sigma_t by which the path flies.
  FloatStates<1> weight_;
  FloatStates<> d_weight_, edge_;
  FloatStates<1> likelihood_;
  FloatStates<> score_, radiance_, derivatives_, flight_sigma_t_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
