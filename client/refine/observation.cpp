#include "client/refine/observation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"

namespace itn {
namespace {

void check_plane(const Observation& observation, const std::vector<float>& plane, const char* what,
                 bool required) {
  if (plane.empty() && !required) return;
  const SerializedScene& scene = *observation.scene;
  if (plane.size() != size_t{scene.width} * scene.height) {
    throw invalid_input(fmt::format("{}: the {} has {} pixels, the film of its scene {} x {}",
                                    observation.name, what, plane.size(), scene.width,
                                    scene.height));
  }
  const auto wrong = std::ranges::find_if(plane, [](float v) { return !std::isfinite(v); });
  if (wrong != plane.end()) {
    const auto pixel = static_cast<size_t>(wrong - plane.begin());
    throw invalid_input(fmt::format("{}: the {} is {} at pixel ({}, {}); it must be finite",
                                    observation.name, what, *wrong, pixel % scene.width,
                                    pixel / scene.width));
  }
}

}  // namespace

void validate(const Observation& observation) {
  check_plane(observation, observation.radiance, "image", true);
  check_plane(observation, observation.mask, "mask", false);
  check_plane(observation, observation.noise, "noise", false);
  for (const std::vector<float>& plane : observation.disturbances) {
    check_plane(observation, plane, "disturbance", false);
  }
  if (std::ranges::any_of(observation.noise, [](float v) { return v < 0; })) {
    throw invalid_input(observation.name + ": the noise (stderr.Y) is below 0 at some pixels");
  }
  double sum = 0;
  bool any = observation.mask.empty();
  for (size_t p = 0; p < observation.radiance.size(); ++p) {
    const bool counts = observation.mask.empty() || observation.mask[p] > 0.5F;
    any = any || counts;
    if (counts) sum += observation.radiance[p];
  }
  if (!any) throw invalid_input(observation.name + ": the mask has no pixel on the object");
  if (!(sum > 0)) throw invalid_input(observation.name + ": the image is black");
}

v1::Scene scene_of(const Observation& observation) {
  v1::Scene scene;
  if (!scene.ParseFromString(observation.scene->bytes))
    throw Error(ErrorKind::kInternal, observation.name + ": its scene cannot be parsed");
  return scene;
}

RenderQuery query_of(const Observation& observation, const Material& material,
                     std::span<const SceneUnknown> unknowns, std::span<const double> values,
                     uint32_t spp, uint64_t seed) {
  // More estimates waste less of the samples, as only products across them count, but their images
  // all travel.
  constexpr uint32_t kEstimates = 4, kPilotSpp = 4;
  RenderQuery query{.scene = observation.scene,
                    .material = material,
                    .spp = spp,
                    .seed = seed,
                    .estimates = kEstimates,
                    .pilot_spp = kPilotSpp,
                    .derivatives = {kMaterialParameters.begin(), kMaterialParameters.end()}};
  for (size_t i = 0; i < unknowns.size(); ++i) {
    query.values.push_back({unknowns[i].name, values[i]});
    query.derivatives.push_back(unknowns[i].name);
  }
  return query;
}

}  // namespace itn
