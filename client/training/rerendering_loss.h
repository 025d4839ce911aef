// The image term of inverse transport networks (Che et al., ICCP 2020, Eq. 10): how far an image is
// from the render of a scene with some material, and where that distance falls. Knows nothing of
// datasets: what it needs is an image, and a scene to render.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <vector>

#include "common/material.h"
#include "common/scene/scene_bytes.h"
#include "server/tracer/film/weighted_image_loss.h"

namespace itn {

class RenderPool;

struct RerenderingQuery {
  std::span<const float> image, weight;          // by pixel; weights >= 0
  std::shared_ptr<const SerializedScene> scene;  // what the image is compared with a render of
  Material material;                             // of that render
  uint64_t seed = 0;
};

// For each query an unbiased estimate of the loss and of its gradient in (sigma_t, albedo, g). May
// throw Error.
using RerenderingEvaluator =
    std::function<std::vector<tracer::LossWithGradient>(std::span<const RerenderingQuery>)>;

struct RerenderingSettings {
  uint32_t spp = 256;      // samples per pixel, over all estimates
  uint32_t estimates = 4;  // independent ones, at least 2
  uint32_t pilot_spp = 4;
};

// Renders all queries at the same time by a pool, which must outlive it.
RerenderingEvaluator pool_rerendering(RenderPool& pool, const RerenderingSettings& settings,
                                      std::stop_token stop = {});

}  // namespace itn
