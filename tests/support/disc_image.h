// An image of a shaded disc, for predictors.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "common/scene/wire_array.h"
#include "itn/v1/predict.pb.h"

namespace itn::testing {

// An image of side x side pixels, the disc two thirds of it wide; the phase is where its shade
// begins.
inline v1::PredictRequest disc_image(int side, double phase) {
  std::vector<float> pixels, mask;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double u = 3 * (x + 0.5) / side - 1.5, v = 3 * (y + 0.5) / side - 1.5;
      mask.push_back(u * u + v * v < 1 ? 1.0F : 0.0F);
      pixels.push_back(static_cast<float>(mask.back() * (1.5 + std::sin(2 * u + phase))));
    }
  }
  v1::PredictRequest request;
  request.set_width(static_cast<uint32_t>(side));
  request.set_height(static_cast<uint32_t>(side));
  request.set_image(to_bytes(pixels));
  request.set_mask(to_bytes(mask));
  return request;
}

}  // namespace itn::testing
