// How the object of a photograph stands before the camera and in the light: its pose, and the turn
// of a panorama where nobody says it.
#pragma once

#include <cstddef>
#include <vector>

#include "client/commands/fit.h"
#include "client/commands/fit_photograph.h"
#include "client/fit/pose_search.h"
#include "client/refine/observation.h"
#include "client/render/job_renderer.h"
#include "common/material.h"

namespace itn {

struct FoundStand {
  FoundPose pose;
  Stand stand;                  // with that pose
  size_t alike = 1;             // poses that the silhouette does not tell apart
  bool ambiguous = false;       // light and shade do not tell them apart, either
  bool turn_ambiguous = false;  // another turn of the panorama fits about as well
  // Roughly: the luminance's, and that of each channel of the photograph.
  Material material;
  std::vector<Material> materials;
};

// Planes of Observation::disturbances: by disturbance, and by channel of the photograph.
using Disturbances = std::vector<std::vector<std::vector<float>>>;

// `scene`: as scene_of() has it, with its files loaded. Throws Error (invalid input) if the shape
// fits the mask nowhere, or no pixel shows the object alone; (cancelled); what the pool throws.
FoundStand find_stand(const FitPhotograph& photograph, const Mesh& mesh, const v1::Scene& scene,
                      const FitOptions& options, JobRenderer& pool);

// What errors of the stand do to the photograph, and a g that is another. Throws as find_stand().
Disturbances disturbances_of(const FitPhotograph& photograph, const Mesh& mesh,
                             const FoundStand& found, const v1::Scene& scene,
                             const FitOptions& options, JobRenderer& pool);

// The same of a scene that is given, with the object where it stands: of another g alone. `mask`:
// pixels of its film.
Disturbances disturbances_of_g(const v1::Scene& scene, const std::vector<Material>& materials,
                               const std::vector<float>& mask, const FitOptions& options,
                               JobRenderer& pool);

// Adds channels that itn refine reads.
void add_disturbances(const Disturbances& disturbances, Image& image);

// The material of another g that looks about alike.
Material of_similar_light(const Material& material, double g);

inline constexpr const char* kRoughness = "rough_dielectric.roughness";
inline constexpr const char* kIndex = "rough_dielectric.index";

}  // namespace itn
