#include "client/refine/likeness.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace itn {
namespace {

using Plane = std::vector<double>;

// A disc in an image of kWidth pixels a row.
constexpr uint32_t kWidth = 12;
double column(uint32_t pixel) {
  return pixel % kWidth;
}
double row(uint32_t pixel) {
  return static_cast<double>(pixel / kWidth);
}
std::vector<uint32_t> disc() {
  std::vector<uint32_t> pixels;
  for (uint32_t p = 0; p < kWidth * kWidth; ++p) {
    if (std::hypot(column(p) - 5.5, row(p) - 5.5) < 5) pixels.push_back(p);
  }
  return pixels;
}

struct Planes {
  Plane weights, radiance, derivative;
};
Planes planes_of(const std::vector<uint32_t>& pixels) {
  Planes planes;
  for (const uint32_t p : pixels) {
    const double x = column(p), y = row(p);
    planes.radiance.push_back(1 + 0.5 * std::sin(x));
    planes.weights.push_back(1000 / planes.radiance.back());
    planes.derivative.push_back(std::cos(0.7 * x) * y);
  }
  return planes;
}

// The covariance itself, where squares are pixels.
Matrix covariance_of(const std::vector<uint32_t>& pixels, const Planes& planes,
                     const Likeness& likeness) {
  const std::ptrdiff_t count = std::ssize(pixels);
  Matrix covariance(count, count);
  for (size_t i = 0; i < pixels.size(); ++i) {
    for (size_t k = 0; k < pixels.size(); ++k) {
      const double x = column(pixels[i]) - column(pixels[k]);
      const double y = row(pixels[i]) - row(pixels[k]);
      covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) =
          std::pow(likeness.size, 2) * planes.radiance[i] * planes.radiance[k] *
              std::exp(-(x * x + y * y) / (2 * std::pow(likeness.length, 2))) +
          (i == k ? 1 / planes.weights[i] : 0);
    }
  }
  return covariance;
}

Vector vector_of(const Plane& plane) {
  return Eigen::Map<const Vector>(plane.data(), std::ssize(plane));
}

TEST(AlikePixels, MultiplyByTheInverseOfTheCovariance) {
  // Of lengths whose squares are single pixels; from hardly any likeness to much more than noise.
  for (const Likeness likeness : {Likeness{1e-4, 1}, Likeness{0.012, 3}, Likeness{0.5, 3.9}}) {
    const std::vector<uint32_t> pixels = disc();
    const Planes planes = planes_of(pixels);
    std::vector<Plane> weighed{planes.derivative, planes.radiance};
    AlikePixels(pixels, kWidth, likeness).weigh(planes.weights, planes.radiance, weighed);
    const Matrix covariance = covariance_of(pixels, planes, likeness);
    const Vector derivative = vector_of(planes.derivative), radiance = vector_of(planes.radiance);
    EXPECT_LT((covariance * vector_of(weighed[0]) - derivative).norm(), 1e-7 * derivative.norm());
    EXPECT_LT((covariance * vector_of(weighed[1]) - radiance).norm(), 1e-7 * radiance.norm());
  }
}

// What all pixels share tells the less the more alike they are, and what differs from pixel to
// pixel as much as ever.
TEST(AlikePixels, LeaveWhatIsNotAlike) {
  const std::vector<uint32_t> pixels = disc();
  const Planes planes = planes_of(pixels);
  std::vector<Plane> weighed{planes.radiance, planes.radiance};
  Plane& rough = weighed[1];
  for (size_t i = 0; i < pixels.size(); ++i) {
    rough[i] *= (pixels[i] % kWidth + pixels[i] / kWidth) % 2 == 0 ? 1 : -1;
  }
  const Plane before = rough;
  AlikePixels(pixels, kWidth, {.size = 0.1, .length = 9})
      .weigh(planes.weights, planes.radiance, weighed);
  double smooth_part = 0, rough_part = 0, all = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    smooth_part += weighed[0][i] * planes.radiance[i];
    rough_part += rough[i] * before[i];
    all += planes.weights[i] * planes.radiance[i] * planes.radiance[i];
  }
  EXPECT_LT(smooth_part, 0.05 * all);
  EXPECT_GT(rough_part, 0.9 * all);
}

}  // namespace
}  // namespace itn
