// Analysis by synthesis: the material of an object of known shape in known light, from one image or
// several, as the one whose renders are like them.
//
//   Refinement refinement(settings, observations, {start});
//   const Renderer renderer = rendered_by(pool);
//   while (!refinement.finished()) refinement.step(renderer);
//   const v1::RefineResult result = refinement.result();
//
// Damped Gauss-Newton steps in UNBOUNDED coordinates (common/learning/parameterization.h), by
// normal equations whose every product is one of independent quantities, so that the noise of the
// renders biases neither them nor the answer (client/refine/normal_equations.h).
//
// Images may show several colours of an object, each with a sigma_t and an albedo of its own. They
// share the numbers of the scene that are unknown, the exposure, and g unless the settings say
// that each has its own.
#pragma once

#include <chrono>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/refine/coordinates.h"
#include "client/refine/observation.h"
#include "common/material.h"
#include "itn/v1/refine.pb.h"

namespace itn {

class Descent;  // client/refine/descent.h

// With the defaults of the method where nothing is said.
v1::RefineSettings with_defaults(v1::RefineSettings settings);

// `start`, and others spread about it in UNBOUNDED coordinates, within 1.5 of it in each; always
// the same ones.
std::vector<Material> starts_around(const Material& start, size_t count);

// The digest of images and scenes, 32 bytes.
std::string digest_of(std::span<const Observation> observations);

class Refinement {
 public:
  // From each of the starts (at least one), which all colours have in common, and where the scenes
  // have the unknowns of the settings. `seconds_before`, which went by before, are part of the time
  // limit.
  // The observations, at least one, must outlive it. Throws Error (invalid input) as validate() of
  // observations and materials and scene_unknowns() do, and if settings are out of their ranges.
  Refinement(v1::RefineSettings settings, std::span<const Observation> observations,
             const std::vector<Material>& starts, double seconds_before = 0);
  // Goes on from a state, to the same answer bit for bit. Throws Error (invalid input) if it is one
  // of other observations, or damaged.
  Refinement(std::span<const Observation> observations, const v1::RefineState& state);
  Refinement(Refinement&&) noexcept;
  ~Refinement();

  // For tests: what tells the time, in seconds, instead of the machine's clock.
  void use_clock(std::function<double()> clock) { clock_ = std::move(clock); }

  bool finished() const;

  // One iteration of one start: every start is brought some way, then the best goes on alone. Not
  // to be called once finished. Throws what `renderer` throws, and Error (invalid input) if a
  // render does not fit an image; nothing has changed then.
  const v1::RefineIteration& step(const Renderer& renderer);

  size_t colours() const;
  // The result of the best start as it stands, once there was a step.
  v1::RefineResult result(size_t colour = 0) const;
  Material material(size_t colour = 0) const;
  double exposure() const;  // the images over the renders
  // Pixels of an observation that no material explains, and that count for less.
  std::vector<uint32_t> unexplained_pixels(size_t observation) const;
  // A render of one of the observations with the material and the unknowns of the scene.
  RenderQuery query(const Observation& observation, uint32_t spp, uint64_t seed) const;

  // All iterations, in the order in which they were made.
  const std::vector<v1::RefineIteration>& trajectory() const { return trajectory_; }

  v1::RefineState state() const;

 private:
  size_t best() const;
  size_t next() const;
  void keep_time_limit();

  v1::RefineSettings settings_;
  std::span<const Observation> observations_;
  std::string digest_;
  Layout layout_;
  std::vector<Descent> descents_;
  std::vector<v1::RefineIteration> trajectory_;
  double seconds_before_ = 0;
  std::function<double()> clock_ = [] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
  };
};

}  // namespace itn
