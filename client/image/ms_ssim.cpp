#include "client/image/ms_ssim.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "common/error.h"
#include "common/image/square_view.h"

namespace itn {
namespace {

constexpr std::array kWeights = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
constexpr int kWindow = 11;
constexpr double kDeviation = 1.5, kK1 = 0.01, kK2 = 0.03;

// The window's mean around each pixel where it fits.
cv::Mat local_mean(const cv::Mat& image) {
  cv::Mat blurred;
  cv::GaussianBlur(image, blurred, cv::Size(kWindow, kWindow), kDeviation);
  constexpr int kReach = kWindow / 2;
  return blurred(cv::Range(kReach, image.rows - kReach), cv::Range(kReach, image.cols - kReach));
}

struct Similarity {
  double structure;  // mean of cs
  double whole;      // mean of l cs
};

Similarity similarity(const cv::Mat& x, const cv::Mat& y, double range) {
  const double c1 = kK1 * range * kK1 * range, c2 = kK2 * range * kK2 * range;
  const cv::Mat mean_x = local_mean(x), mean_y = local_mean(y);
  const cv::Mat squares = mean_x.mul(mean_x) + mean_y.mul(mean_y), product = mean_x.mul(mean_y);
  const cv::Mat variances = local_mean(x.mul(x) + y.mul(y)) - squares;
  const cv::Mat covariance = local_mean(x.mul(y)) - product;
  cv::Mat luminance, structure;
  cv::divide(2 * product + c1, squares + c1, luminance);
  cv::divide(2 * covariance + c2, variances + c2, structure);
  return {cv::mean(structure)[0], cv::mean(luminance.mul(structure))[0]};
}

cv::Mat halved(const cv::Mat& image) {
  const int rows = image.rows / 2, columns = image.cols / 2;
  cv::Mat half;  // without the last row and column of an odd number
  cv::resize(image(cv::Range(0, 2 * rows), cv::Range(0, 2 * columns)), half,
             cv::Size(columns, rows), 0, 0, cv::INTER_AREA);
  return half;
}

size_t scales_of(int side) {
  size_t scales = 0;
  for (; side >= kWindow && scales < kWeights.size(); side /= 2) ++scales;
  return scales;
}

}  // namespace

double ms_ssim(int side, std::span<const float> reference, std::span<const float> image) {
  const auto pixels = static_cast<size_t>(side) * static_cast<size_t>(side);
  if (reference.size() != pixels || image.size() != pixels) {
    throw invalid_input(fmt::format("images of {} and {} pixels are compared as {} x {}",
                                    reference.size(), image.size(), side, side));
  }
  const size_t scales = scales_of(side);
  if (scales == 0) {
    throw invalid_input(fmt::format(
        "images of {} pixels a side are too small to compare by a window of {}", side, kWindow));
  }
  const double range = *std::ranges::max_element(reference);
  if (!(range > 0)) throw invalid_input("the reference image is black");
  cv::Mat x, y;
  square_view(side, reference).convertTo(x, CV_64F);
  square_view(side, image).convertTo(y, CV_64F);
  const double weights = std::accumulate(
      kWeights.begin(), kWeights.begin() + static_cast<std::ptrdiff_t>(scales), 0.0);
  double result = 1;
  for (size_t scale = 0; scale < scales; ++scale) {
    const Similarity s = similarity(x, y, range);
    const double mean = scale + 1 < scales ? s.structure : s.whole;
    result *= std::pow(std::max(0.0, mean), kWeights[scale] / weights);
    x = halved(x);
    y = halved(y);
  }
  return result;
}

}  // namespace itn
