// An image whose scene is known, and the renders that it is compared with.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/refine/scene_unknown.h"
#include "client/render/render_query.h"
#include "common/material.h"
#include "common/scene/scene_bytes.h"

namespace itn {

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
  // The photograph that it is of. What a scene leaves out differs alike in all its colours.
  size_t photograph = 0;
};

// Throws Error (invalid input) that says what is wrong: sizes, numbers that are not finite, nothing
// but black on the object.
void validate(const Observation& observation);

// Asks for the observation's scene with this material and these values of its unknowns, and for
// derivatives in all of them.
RenderQuery query_of(const Observation& observation, const Material& material,
                     std::span<const SceneUnknown> unknowns, std::span<const double> values,
                     uint32_t spp, uint64_t seed);

// The scene that was serialized.
v1::Scene scene_of(const Observation& observation);

}  // namespace itn
