// An image whose scene is known, and the renders that it is compared with.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "client/refine/scene_unknown.h"
#include "common/material.h"
#include "common/scene/scene_bytes.h"
#include "server/tracer/film/weighted_image_loss.h"

namespace itn {

class RenderPool;

// Planes have the size of the scene's film, top row first.
struct Observation {
  std::string name;             // for messages
  std::vector<float> radiance;  // on the scale of the scene's lights, unless exposure is unknown
  std::vector<float> mask;      // pixels above 0.5 count; empty: all that see the object
  std::vector<float> noise;     // standard errors of the radiance; empty: not known
  std::shared_ptr<const SerializedScene> scene;
  // What is not known of the scene changes the image by parts of its radiance: planes of what a
  // standard deviation of each does, in the order of all disturbances of a refinement; empty where
  // this image has none of one.
  std::vector<std::vector<float>> disturbances = {};
  size_t colour = 0;  // which of the colours of a refinement it shows, each of its own material
};

// Throws Error (invalid input) that says what is wrong: sizes, numbers that are not finite, nothing
// but black on the object.
void validate(const Observation& observation);

// A render of an observation's scene that is asked for.
struct SynthesisQuery {
  const Observation* observation = nullptr;
  Material material;
  std::span<const SceneUnknown> unknowns;  // of the scene, and
  std::vector<double> values;              // what they are
  uint32_t spp = 0;
  uint64_t seed = 0;
};

struct Synthesis {
  // Independent of one another, at least 2; derivatives in sigma_t, albedo, g and the unknowns.
  std::vector<tracer::RenderEstimate> estimates;
  std::vector<float> mask;  // part of each pixel that the object covers
  double cpu_seconds = 0;
};

// Renders each of them. May throw Error.
using Synthesize = std::function<std::vector<Synthesis>(std::span<const SynthesisQuery>)>;

// As it was serialized.
v1::Scene scene_of(const Observation& observation);

// All at the same time by a pool, which must outlive it.
Synthesize rendered_by(RenderPool& pool, std::stop_token stop = {});

}  // namespace itn
