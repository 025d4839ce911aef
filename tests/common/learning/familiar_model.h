// A small untrained model that knows what its images are like.
#pragma once

#include <cstdint>

#include "common/learning/outlier_detector.h"
#include "common/learning/predictor.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {

// Discs with a soft pattern: each of another brightness, slope and noise.
inline ImageBatch discs(int64_t count, int64_t side, uint64_t seed) {
  torch::manual_seed(seed);
  const torch::Tensor at = (torch::arange(side) + 0.5) / static_cast<double>(side) * 3 - 1.5;
  const torch::Tensor inside = (at.square().unsqueeze(1) + at.square() < 1).to(torch::kFloat32);
  const auto each = [&](const torch::Tensor& x) { return x.view({count, 1, 1}); };
  const torch::Tensor slope = each(0.2 * torch::randn({count})) * at.view({1, 1, side});
  const torch::Tensor noise =
      each(0.05 + 0.05 * torch::rand({count})) * torch::randn({count, side, side});
  ImageBatch images;
  images.mask = inside.expand({count, side, side}).contiguous();
  images.luminance =
      images.mask *
      (each((0.3 * torch::randn({count})).exp()) * (1 + slope) * (1 + noise)).clamp_min(0);
  return images;
}

using MakeImages = ImageBatch (*)(int64_t count, int64_t side, uint64_t seed);

// A residual_model().
inline v1::Model model_with_outlier_model(MakeImages images = discs, int resolution = 32) {
  v1::Model model = residual_model(resolution);
  Predictor predictor(model);
  const ImageBatch training = images(400, resolution, 1);
  *model.mutable_outlier_model() =
      fit_outlier_model(predictor.features(training),
                        {.encoded = image_statistics(model, tone_mapped(training)),
                         .shuffled = image_statistics(model, shuffled(training))},
                        predictor.features(images(400, resolution, 2)));
  return model;
}

}  // namespace itn
