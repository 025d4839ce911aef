// Independent estimates of a render, as tracer, workers and clients hand them on.
#pragma once

#include <cstdint>
#include <vector>

namespace itn {

// An estimate has the means over its samples, which are 0 in pixels without any. Images have width
// * height numbers, top row first, of radiance or of its derivative by the parameter's unit. All
// but the radiance is empty unless it was asked for (RenderGradRequest).
struct RenderEstimate {
  std::vector<float> radiance;
  std::vector<std::vector<float>> derivatives;  // in the order in which they were asked for
  std::vector<std::vector<float>> other_media;  // radiance for each further albedo or colour
  std::vector<double> gradient = {};            // instead of derivatives, in their order
  std::vector<float> map_gradient = {};         // by pixel of the panorama, top row first
  // In unit normals of the object's boundary: for each triangle, x, y and z at its three corners.
  std::vector<float> normal_gradient = {};
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
