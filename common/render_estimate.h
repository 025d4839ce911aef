// Independent estimates of a render, as tracer, workers and clients hand them on.
#pragma once

#include <cstdint>
#include <vector>

namespace itn {

// Means over the samples of one estimate: 0 where there are none. All images have width * height
// numbers, top row first.
struct RenderEstimate {
  std::vector<float> radiance;
  std::vector<std::vector<float>> derivatives;  // in the order in which they were asked for
  std::vector<std::vector<float>> other_media;  // radiance for each further albedo or colour
  std::vector<double> gradient = {};            // instead of derivatives, in their order
  std::vector<float> map_gradient = {};         // by pixel of the panorama, top row first
  std::vector<float> normal_gradient = {};      // by triangle of the object, corner and coordinate
};

// The number of samples, of `count`, that belong to estimate k: sample i is of estimate i mod
// `estimates`.
inline uint32_t samples_of_estimate(uint32_t count, uint32_t k, uint32_t estimates) {
  return (count + estimates - 1 - k) / estimates;
}

// The loss of a render against an image, and its gradient.
struct LossWithGradient {
  double value = 0;
  std::vector<double> gradient;  // in the order of the estimates' derivatives
};

}  // namespace itn
