// The image term of inverse transport networks (Che et al., ICCP 2020, Eq. 10): how far an image is
// from the render of a scene with some material, and where that distance falls. Knows nothing of
// datasets: what it needs is an image, and a scene to render.
#pragma once

#include <functional>
#include <span>
#include <stop_token>
#include <vector>

#include "client/render/render_query.h"

namespace itn {

// For each query, which has an image and weights, an unbiased estimate of the loss and of its
// gradient in (sigma_t, albedo, g). May throw Error.
using RerenderingEvaluator =
    std::function<std::vector<LossWithGradient>(std::span<const RenderQuery>)>;

struct RerenderingSettings {
  uint32_t spp = 256;      // samples per pixel, over all estimates
  uint32_t estimates = 4;  // independent ones, at least 2
  uint32_t pilot_spp = 4;
};

// Renders all queries at the same time by a pool, which must outlive it, with these samples.
RerenderingEvaluator pool_rerendering(JobRenderer& pool, const RerenderingSettings& settings,
                                      std::stop_token stop = {});

}  // namespace itn
