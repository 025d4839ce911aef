#include "common/learning/weight_map.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

namespace itn {
namespace {

// What maps to white: the brightest pixels may be a few fireflies.
constexpr double kWhitePercentile = 0.98;
// In pixels. A render's noise is independent from pixel to pixel; a blur of one pixel takes most of
// it away and moves no edge.
constexpr double kBlur = 1.0;
// Hysteresis of the Canny detector, on the gradient of a 3x3 Sobel filter over 8-bit values.
constexpr double kWeakEdge = 60, kStrongEdge = 150;
constexpr float kOnObject = 0.5F;
constexpr double kReach = 0.25;  // D over the longer image side

cv::Mat on_object(int width, int height, std::span<const float> mask) {
  cv::Mat result(height, width, CV_8U);
  std::transform(mask.begin(), mask.end(), result.begin<uchar>(),
                 [](float m) { return m > kOnObject ? uchar{255} : uchar{0}; });
  return result;
}

float white_level(std::span<const float> luminance, std::span<const float> mask) {
  std::vector<float> values;
  for (size_t i = 0; i < luminance.size(); ++i) {
    if (mask[i] > kOnObject) values.push_back(luminance[i]);
  }
  if (values.empty()) return 0;
  const auto nth = values.begin() + static_cast<ptrdiff_t>(kWhitePercentile *
                                                           static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// 8-bit, on a scale on which equal steps look about equal.
cv::Mat display_values(int width, int height, std::span<const float> luminance,
                       std::span<const float> mask) {
  const float white = white_level(luminance, mask);
  cv::Mat result = cv::Mat::zeros(height, width, CV_8U);
  if (white > 0) {
    std::transform(luminance.begin(), luminance.end(), mask.begin(), result.begin<uchar>(),
                   [white](float y, float m) {
                     const float value = m > kOnObject ? std::sqrt(std::min(y / white, 1.0F)) : 0;
                     return static_cast<uchar>(std::lround(255 * value));
                   });
  }
  cv::GaussianBlur(result, result, cv::Size(), kBlur, kBlur, cv::BORDER_REPLICATE);
  return result;
}

// Pixels of the object that touch the outside.
cv::Mat silhouette(const cv::Mat& object) {
  cv::Mat inner;
  cv::erode(object, inner, cv::Mat(), cv::Point(-1, -1), 1, cv::BORDER_CONSTANT, cv::Scalar(255));
  return object & ~inner;
}

}  // namespace

std::vector<float> weight_map(int width, int height, std::span<const float> luminance,
                              std::span<const float> mask) {
  const cv::Mat object = on_object(width, height, mask);
  std::vector<float> weights(mask.size(), 0);
  if (cv::countNonZero(object) == 0) return weights;
  // Edges: those inside, and the silhouette.
  cv::Mat edges;
  cv::Canny(display_values(width, height, luminance, mask), edges, kWeakEdge, kStrongEdge);
  edges = (edges & object) | silhouette(object);
  if (cv::countNonZero(edges) == 0) {  // the object fills the image, evenly
    return weights;
  }
  // Distance to the nearest of them.
  cv::Mat distance;
  cv::distanceTransform(~edges, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE, CV_32F);
  // Weight.
  const auto reach = static_cast<float>(kReach * std::max(width, height));
  for (size_t i = 0; i < weights.size(); ++i) {
    weights[i] =
        mask[i] * std::max(0.0F, 1 - distance.begin<float>()[static_cast<ptrdiff_t>(i)] / reach);
  }
  return weights;
}

}  // namespace itn
