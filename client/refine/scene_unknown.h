// Numbers of the scenes that are found with the material: any that images have a derivative in, by
// the name of that (server/tracer/parameters/parameter.h).
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/refine/logit_scale.h"
#include "itn/v1/scene.pb.h"

namespace itn {

struct SceneUnknown {
  // The name of a parameter, such as "rough_dielectric.index", "surface[0].reflectance",
  // "light[0].sphere.center.x".
  std::string name;
  double start = 0;  // in the scene files
  LogitScale range;
  std::optional<double> deviation = {};  // how well `start` is known, as a standard deviation
};

// `deviations`: by name, of those whose start is known so well. Throws Error (invalid input) that
// says which name is none, or none of a scene's, stands twice, or is of scenes that differ in it;
// or what is wrong with a scene.
std::vector<SceneUnknown> scene_unknowns(std::span<const std::string> names,
                                         std::span<const v1::Scene> scenes,
                                         const std::map<std::string, double>& deviations = {});

}  // namespace itn
