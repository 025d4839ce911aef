// A small untrained model.
#pragma once

#include "common/learning/encoder.h"
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

inline v1::Model small_model(v1::Parameterization parameterization = v1::SIMILARITY,
                             int resolution = 16) {
  v1::Model model;
  model.set_name("test");
  model.set_resolution(static_cast<uint32_t>(resolution));
  model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(2);
  model.set_output(v1::POINT);
  model.set_parameterization(parameterization);
  const Triple mean = to_coordinates(parameterization, {100, 0.7, 0.4});
  for (int i = 0; i < 3; ++i) {
    model.add_mean(mean[i]);
    model.add_standard_deviation(mean[i] / 4);
  }
  model.set_image_scale(1);
  *model.mutable_bounds() = prediction_bounds(paper_range());
  torch::manual_seed(1);
  store_weights(*new_encoder(model), model);
  return model;
}

}  // namespace itn
