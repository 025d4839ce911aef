#include "client/training/noise_map.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <opencv2/imgproc.hpp>

#include "common/image/square_view.h"

namespace itn {
namespace {

constexpr double kSmoothing = 1.5;  // pixels, the Gaussian's standard deviation

cv::Mat resized(const cv::Mat& image, int resolution) {
  cv::Mat result;
  cv::resize(image, result, cv::Size(resolution, resolution), 0, 0, cv::INTER_AREA);
  return result;
}

cv::Mat smoothed(const cv::Mat& image) {
  cv::Mat result;
  cv::GaussianBlur(image, result, cv::Size(), kSmoothing);
  return result;
}

}  // namespace

torch::Tensor noise_map(const DatasetImage& image, int side, int resolution) {
  torch::Tensor map = torch::zeros({1, resolution, resolution});
  if (image.standard_error.empty()) return map;
  const cv::Mat mask = square_view(side, image.mask);
  const cv::Mat error = square_view(side, image.standard_error).mul(mask);
  const cv::Mat radiance = resized(square_view(side, image.radiance).mul(mask), resolution);
  // The variance of a mean over n pixels is the mean of their variances over n. (One that is drawn
  // larger has the noise of its own pixels.)
  const double pixels = std::max(1.0, std::pow(static_cast<double>(side) / resolution, 2));
  const cv::Mat noise = smoothed(resized(error.mul(error), resolution) / pixels);
  const cv::Mat energy = smoothed(radiance.mul(radiance));
  const cv::Mat object = resized(mask, resolution);
  auto values = map.accessor<float, 3>();
  for (int y = 0; y < resolution; ++y) {
    for (int x = 0; x < resolution; ++x) {
      const float n = noise.at<float>(y, x), e = energy.at<float>(y, x);
      if (!(object.at<float>(y, x) > 0) || n == 0) continue;
      // The noise is part of the energy that is measured.
      values[0][y][x] = e > n ? std::sqrt(n / (e - n)) : std::numeric_limits<float>::infinity();
    }
  }
  return map;
}

}  // namespace itn
