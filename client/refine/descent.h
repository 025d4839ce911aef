// One start of a refinement, on its way down.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "client/refine/coordinates.h"
#include "client/refine/matrix.h"
#include "client/refine/normal_equations.h"
#include "client/refine/observation.h"
#include "client/refine/region.h"
#include "client/refine/score_test.h"
#include "common/material.h"
#include "itn/v1/refine.pb.h"

namespace itn {

// Whether g is known so well that it is not found.
bool is_g_given(const v1::RefineSettings& settings);

// Gauss-Newton, whose steps are as long as their noise lets them be trusted: each goes to the best
// guess of where the answer lies for one who expects it about `trust_radius` away in every
// coordinate (client/refine/score_test.h), and is no longer than that. So a direction that the
// image hardly tells is not gone along until there are samples enough (the similarity ridge), while
// quiet steps are Newton's. A step after which the loss is higher is taken back, and the radius
// reduced (Levenberg-Marquardt). The equations of earlier iterations count with those of the new
// one, the less the farther they came from. A step within its own noise calls for more samples.
class Descent {
 public:
  Descent(const v1::RefineSettings& settings, Layout layout,
          std::span<const Observation> observations, const Material& start);
  // Throws Error (invalid input) if the state does not fit.
  Descent(const v1::RefineSettings& settings, Layout layout,
          std::span<const Observation> observations, const v1::RefineStartState& state);

  // Renders where it stands, and steps on. Nothing changes if that throws. `seed`: of the renders.
  v1::RefineIteration step(const Renderer& renderer, uint64_t seed);

  v1::RefineResult::End end() const { return end_; }
  void set_end(v1::RefineResult::End end) { end_ = end; }
  uint32_t iterations() const { return iterations_; }
  // The loss where it was measured last, without noise of the renders: an unbiased estimate.
  double loss() const { return loss_; }
  double loss_standard_error() const { return loss_standard_error_; }
  // The part of that loss that the image's own noise explains; 0 if it is not known.
  double noise_loss() const { return noise_loss_; }
  // Squares of pixels (RefineSettings.block) that count, over all photographs, and coordinates of
  // what images of a colour show.
  double squares() const { return squares_; }
  double numbers() const { return static_cast<double>(seen_.size()); }
  // Pixels of an image that no material explains; and which part of all pixels those are.
  std::vector<uint32_t> unexplained_pixels(size_t image) const {
    return image_equations_[image].unexplained_pixels();
  }
  double unexplained_part() const;
  // The structure of the differences there.
  const Structure& structure() const { return structure_; }

  // The answer as it stands.
  Material material(size_t colour = 0) const { return material_at(seen_in(x_, colour)); }
  std::vector<double> unknowns() const { return unknowns_at(seen_in(x_, 0), seen_); }
  double exposure() const { return exposure_at(seen_in(x_, 0), seen_); }
  // The materials that the images do not contradict, as points along the coordinate that they may
  // hardly tell: logit g or, where g is given, ln sigma_t of this colour.
  Region region(size_t colour) const;
  // Whether the last iteration was still farther from where the equations lead than that is
  // uncertain.
  bool is_under_way() const;

  // Samples per pixel of the next iteration; and no more than so many of it.
  uint32_t spp() const { return spp_; }
  void limit_spp(uint32_t most) { spp_ = std::min(spp_, most); }

  v1::RefineStartState state() const;

 private:
  struct Step {
    Vector taken;
    double over_noise = 0, over_uncertainty = 0;
  };
  struct Evaluation;
  Evaluation evaluate(const Renderer& renderer, uint64_t seed);
  void accumulate(const Evaluation& evaluation);
  Step newton_step() const;
  Step adam_step(const Vector& gradient);
  // The coordinates of what an image of a colour shows.
  Vector seen_in(const Vector& x, size_t colour) const { return x(layout_.of_colour(colour)); }
  void collect_sums();
  void collect_moments();
  Eigen::Index add_moments(std::span<const size_t> images);
  // Whether an image tells something of a coordinate.
  bool tells(size_t image, Eigen::Index coordinate) const;
  void collect_model_error();
  ScoreEquations score_equations(size_t colour) const;
  std::vector<KnownStep> known_steps() const;
  ScoreTest test(size_t colour) const;
  ScoreTest render_test() const;
  void plan(const Step& step, double deviation, double share);

  bool is_adam() const { return settings_.method() == v1::RefineSettings::ADAM; }

  v1::RefineSettings settings_;
  Layout layout_, seen_;  // of all, and of what an image shows
  std::span<const Observation> observations_;
  std::vector<ImageEquations> image_equations_;
  NormalEquations normal_equations_;
  NormalEquations unexplained_;        // part of these, of pixels that no material explains
  std::vector<ScoreMoments> moments_;  // by photograph
  double squares_ = 0;                 // of all of them
  Matrix model_error_;                 // covariance of s by RefineSettings.model_error; empty: none
  Vector x_, linearization_point_;
  double samples_ = 0;
  double trust_radius_ = 1;
  double loss_ = 0, loss_standard_error_ = 0, noise_loss_ = 0;
  Structure structure_;
  uint32_t spp_ = 0, iterations_ = 0;
  uint32_t renders_at_max_spp_ = 0;  // with the most samples, where it does not move any more
  Vector first_moment_, second_moment_;
  v1::RefineResult::End end_ = v1::RefineResult::UNFINISHED;
};

}  // namespace itn
