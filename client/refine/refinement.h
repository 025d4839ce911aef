// Analysis by synthesis: the material of an object of known shape in known light, from one image or
// several, as the one whose renders are like them.
//
//   Refinement refinement(settings, observations, {start});
//   const Synthesize synthesize = rendered_by(pool);
//   while (!refinement.finished()) refinement.step(synthesize);
//   const v1::RefineResult result = refinement.result();
//
// Damped Gauss-Newton steps in UNBOUNDED coordinates (common/learning/parameterization.h), by
// normal equations whose every product is one of independent quantities, so that the noise of the
// renders biases neither them nor the answer (client/refine/normal_equations.h).
#pragma once

#include <span>
#include <vector>

#include "client/refine/observation.h"
#include "common/material.h"
#include "itn/v1/refine.pb.h"

namespace itn {

class Descent;

// The defaults of a method where nothing is said.
v1::RefineSettings with_defaults(v1::RefineSettings settings);

class Refinement {
 public:
  // From each of the starts (at least one). The observations, at least one, must outlive it. Throws
  // Error (invalid input) as validate() does, and if settings or starts are out of their ranges.
  Refinement(v1::RefineSettings settings, std::span<const Observation> observations,
             const std::vector<Material>& starts);
  // Goes on from a state, to the same results bit for bit. Throws Error (invalid input) if it is
  // one of other observations, or damaged.
  Refinement(std::span<const Observation> observations, const v1::RefineState& state);
  ~Refinement();

  bool finished() const;

  // One iteration of one start: every start is brought some way, then the best of them to the end.
  // Not to be called once finished. Throws what `synthesize` throws, and stays as it was then.
  const v1::RefineIteration& step(const Synthesize& synthesize);

  // As it stands.
  v1::RefineResult result() const;

  // Of a material known to be the best so far: of the start that is best.
  Material material() const;

  // All iterations, in the order in which they were made.
  std::span<const v1::RefineIteration> trajectory() const { return trajectory_; }

  v1::RefineState state() const;

 private:
  size_t best() const;

  v1::RefineSettings settings_;
  std::span<const Observation> observations_;
  std::vector<Descent> descents_;
  std::vector<v1::RefineIteration> trajectory_;
};

// Of images and scenes.
std::string digest_of(std::span<const Observation> observations);

}  // namespace itn
