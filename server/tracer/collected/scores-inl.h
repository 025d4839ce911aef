// Derivatives in parameters of the object's phase function and boundary.
#if defined(ITN_TRACER_COLLECTED_SCORES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_SCORES_INL_H_
#undef ITN_TRACER_COLLECTED_SCORES_INL_H_
#else
#define ITN_TRACER_COLLECTED_SCORES_INL_H_
#endif

#include <cstddef>
#include <optional>
#include <tuple>
#include <vector>

#include "common/fields.h"
#include "server/tracer/collected/events-inl.h"
#include "server/tracer/collected/medium-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Light counts its contribution times the sum of the scores along its path: one score for each
// parameter that is a slot of its kind (common/fields.h), those of the phase function first. What
// edges of the boundary bring is added to the derivative in its index (BoundaryEdge).
class Scores {
 public:
  Scores(const Scene::Compiled& scene, const RenderRequest& request)
      : camera_score_(scene.camera_score) {
    const std::vector<size_t> in_phase = derivatives_of(request, Parameter::kPhase);
    const std::vector<size_t> in_boundary = derivatives_of(request, Parameter::kBoundary);
    if (asks_for_medium(request)) phase_count_ = slot_count(phase_of(request));
    of_path_.resize(phase_count_ + (in_boundary.empty() ? 0 : slot_count(scene.boundary)));
    if (const auto index = differentiated_index(request, scene.boundary)) {
      index_score_ = phase_count_ + *index;
    }
    if (!request.colours.empty()) return;  // Colours collects
    collected_.resize(of_path_.size());
    control_.resize(phase_count_);
    const auto slot_of = [&](size_t d) { return request.derivatives[d].slot; };
    for (const size_t d : in_phase) {
      derivatives_.push_back({d, slots_of<PhaseFunction>()[slot_of(d)].number});
    }
    for (const size_t d : in_boundary) {
      derivatives_.push_back({d, phase_count_ + slots_of<Boundary>()[slot_of(d)].number});
    }
  }

  // How many scores a path has, and how many of them are the phase function's.
  size_t count() const { return of_path_.size(); }
  size_t phase_count() const { return phase_count_; }
  // The number of the score in the boundary's index, if that is differentiated.
  std::optional<size_t> index_score() const { return index_score_; }
  // The sum of a score along the paths so far; and of all scores, along those in some slots.
  const FloatColumn& of_path(size_t s) const { return of_path_[s]; }
  HWY_INLINE PathScores of_paths(const SlotGather& path) const {
    PathScores scores;
    for (size_t s = 0; s < count(); ++s) scores.of[s] = path.get(of_path_[s]);
    return scores;
  }

  auto columns() { return std::tie(of_path_, collected_, control_); }
  void begin(size_t slot) {
    if (index_score_) of_path_[*index_score_][slot] = camera_score_;
  }

  // Paths in slots i, i + 1 ... turn by these scores. Those of the phase function have a control
  // variate, as the score of MediumDerivatives has.
  HWY_INLINE void on_scattering(size_t i, Mask where, const PhaseValue& phase, Floats weight) {
    for (size_t s = 0; s < phase_count_; ++s) {
      const Floats score = hn::IfThenElseZero(where, phase.scores[s]);
      store(load(of_path_[s], i) + score, of_path_[s], i);
      if (control_.empty()) continue;
      store(mul_add(score, weight, load(control_[s], i)), control_[s], i);
    }
  }
  HWY_INLINE void on_crossing(size_t i, Mask where, const BoundarySample& crossing) {
    for (size_t s = phase_count_; s < count(); ++s) {
      const Floats score = hn::IfThenElseZero(where, crossing.scores[s - phase_count_]);
      store(load(of_path_[s], i) + score, of_path_[s], i);
    }
  }

  HWY_INLINE void on_light(const Light& light) {
    for (size_t s = 0; s < collected_.size(); ++s) {
      light.at.add(light.contribution * light.scores.of[s], collected_[s]);
    }
    if (index_score_) light.at.add(light.by_edges, collected_[*index_score_]);
  }

  void record(size_t slot, float expected, PathEstimate& estimate) const {
    for (const auto& [number, s] : derivatives_) {
      const float control = s < phase_count_ ? expected * control_[s][slot] : 0;
      estimate.derivatives[number] = collected_[s][slot] - control;
    }
  }

 private:
  struct Derivative {
    size_t number, score;  // in the request; in the columns
  };

  const float camera_score_;
  size_t phase_count_ = 0;
  std::optional<size_t> index_score_;
  std::vector<Derivative> derivatives_;
  FloatStates<> of_path_, collected_, control_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
