// Models of random weights, and what a network is made from.
#pragma once

#include "common/learning/encoder.h"
#include "common/learning/network_input.h"
#include "common/learning/parameterization.h"

namespace itn {

inline v1::MaterialRange paper_range() {
  v1::MaterialRange range;
  range.mutable_sigma_t()->set_min(30);
  range.mutable_sigma_t()->set_max(276);
  range.mutable_albedo()->set_min(0.39);
  range.mutable_albedo()->set_max(0.95);
  range.mutable_g()->set_min(0);
  range.mutable_g()->set_max(0.8);
  return range;
}

// What new_encoder() needs: without weights.
inline v1::Model untrained(uint32_t resolution, uint32_t base_channels) {
  v1::Model model;
  model.set_resolution(resolution);
  model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(base_channels);
  model.set_input(v1::LUMINANCE_AND_WEIGHT);
  model.set_output(v1::POINT);
  return model;
}

inline v1::Model untrained_residual(uint32_t resolution, uint32_t base_channels, uint32_t blocks) {
  v1::Model model = untrained(resolution, 1);
  auto& sizes = *model.mutable_architecture()->mutable_residual_convolutions();
  sizes.set_base_channels(base_channels);
  sizes.set_blocks(blocks);
  model.set_input(v1::RATIOS);
  model.set_output(v1::GAUSSIAN);
  return model;
}

inline v1::Model small_model(v1::Parameterization parameterization = v1::SIMILARITY,
                             int resolution = 16) {
  v1::Model model;
  model.set_name("test");
  model.set_resolution(static_cast<uint32_t>(resolution));
  model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(2);
  model.set_output(v1::POINT);
  model.set_input(v1::LUMINANCE_AND_WEIGHT);
  model.set_exposure(v1::EXPOSURE_KNOWN);
  model.set_parameterization(parameterization);
  *model.mutable_bounds() = prediction_bounds(paper_range());
  const MaterialCoordinates mean =
      to_coordinates(parameterization, {100, 0.7, 0.4}, g_interval(model.bounds()));
  for (int i = 0; i < 3; ++i) {
    model.add_mean(mean[i]);
    model.add_standard_deviation(parameterization == v1::UNBOUNDED ? 0.7 : mean[i] / 4);
  }
  model.set_image_scale(1);
  torch::manual_seed(1);
  store_weights(*new_encoder(model), model);
  return model;
}

// A residual network with a Gaussian output, of random weights; with `channels` 3 in colour.
inline v1::Model residual_model(int resolution = 32, v1::Exposure exposure = v1::EXPOSURE_KNOWN,
                                uint32_t channels = 1) {
  v1::Model model = small_model(v1::UNBOUNDED, resolution);
  if (channels == 3) {
    model.set_channels(3);
    const v1::Model gray = model;
    model.clear_mean();
    model.clear_standard_deviation();
    for (const int i : {0, 0, 0, 1, 1, 1, 2}) {
      model.add_mean(gray.mean(i));
      model.add_standard_deviation(gray.standard_deviation(i));
    }
  }
  auto& sizes = *model.mutable_architecture()->mutable_residual_convolutions();
  sizes.set_base_channels(4);
  sizes.set_blocks(2);
  model.set_output(v1::GAUSSIAN);
  model.set_input(v1::RATIOS);
  model.set_exposure(exposure);
  const Encoder encoder = new_encoder(model);
  const torch::NoGradGuard no_gradient;
  // Statistics of some input, so that what the layers pass on is of the size of 1.
  encoder->train();
  for (int batch = 0; batch < 40; ++batch) {
    torch::Tensor input = torch::randn({8, input_channels(model), resolution, resolution});
    input.select(1, -1).fill_(1);  // the mask
    encoder->forward(input);
  }
  for (NamedTensor& named : all_tensors(*encoder)) {
    if (named.name.starts_with("head")) {  // answers inside of the bounds
      named.tensor += 0.03 * torch::randn_like(named.tensor);
    }
  }
  store_weights(*encoder, model);
  return model;
}

}  // namespace itn
