#include "client/fit/disturbances.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "tests/client/refine/synthetic_model.h"

namespace itn {
namespace {

constexpr int kSide = 40, kEstimates = 4;

double radiance(int x, int y) {
  return 2 + std::sin(0.1 * x) + 0.02 * y;
}

// What is a part of the radiance more or less, and noise of 5 % of it.
RenderedChange change(const std::function<double(int, int)>& per_deviation, double apart,
                      uint64_t seed) {
  testing::Gaussian1D gaussian(seed);
  RenderedChange result{.more = {}, .less = {}, .apart = apart};
  for (int e = 0; e < kEstimates; ++e) {
    for (const double sign : {0.5, -0.5}) {
      std::vector<float> image;
      for (int y = 0; y < kSide; ++y) {
        for (int x = 0; x < kSide; ++x) {
          const double relative = 1 + sign * apart * per_deviation(x, y) + 0.05 * gaussian();
          image.push_back(static_cast<float>(radiance(x, y) * relative));
        }
      }
      (sign > 0 ? result.more : result.less).push_back(image);
    }
  }
  return result;
}

// The place of each pixel, and on which of two faces it is, whose edge lies aslant.
std::vector<std::vector<float>> surface() {
  std::vector<std::vector<float>> planes(3);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      planes[0].push_back(static_cast<float>(x));
      planes[1].push_back(static_cast<float>(y));
      planes[2].push_back(x + y / 2 < 30 ? 1.0F : -1.0F);
    }
  }
  return planes;
}

// Two of three errors change the image alike, and one does not.
TEST(Disturbances, AreWhatChangesTheImage) {
  const auto slope = [](int x, int /*y*/) { return 0.001 * (x - 20); };
  const auto half_of_it = [&](int x, int y) { return -0.5 * slope(x, y); };
  const auto nothing = [](int, int) { return 0.0; };
  std::vector<float> mask(size_t{kSide} * kSide, 1);
  for (int x = 0; x < kSide; ++x) mask[static_cast<size_t>(x)] = 0;
  const std::vector<RenderedChange> changes{change(slope, 4, 1), change(half_of_it, 4, 2),
                                            change(nothing, 4, 3)};
  const std::vector<std::vector<float>> planes = disturbances_of(changes, mask, kSide, surface());
  ASSERT_EQ(planes.size(), 1U);
  const double sign = planes[0].back() > 0 ? 1 : -1;
  double squares = 0;
  for (int y = 1; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double expected = std::sqrt(1.25) * slope(x, y);
      const double plane = planes[0][static_cast<size_t>(y * kSide + x)];
      squares += std::pow(sign * plane - expected, 2) / ((kSide - 1) * kSide);
    }
  }
  // The noise of four estimates is 0.05 2^1/2 / 4 / 2 = 0.009 at each pixel, and a few numbers of
  // 1560 pixels are off by less.
  EXPECT_LT(std::sqrt(squares), 0.001);
  EXPECT_EQ(planes[0][3], 0) << "outside of the mask";
}

// A turn makes one face brighter and another one darker, by less than a third of the noise of a
// pixel, of which at most 20 numbers of 1600 pixels are off by a ninth.
TEST(Disturbances, AreToldThroughNoise) {
  const std::vector<std::vector<float>> planes = surface();
  const auto turned = [&](int x, int y) {
    return 0.01 * double{planes[2][static_cast<size_t>(y * kSide + x)]};
  };
  const std::vector<float> mask(size_t{kSide} * kSide, 1);
  const std::vector<std::vector<float>> found =
      disturbances_of(std::vector{change(turned, 1, 5)}, mask, kSide, planes);
  ASSERT_EQ(found.size(), 1U);
  const double sign = found[0][0] > 0 ? 1 : -1;
  double squares = 0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double plane = found[0][static_cast<size_t>(y * kSide + x)];
      squares += std::pow(sign * plane - turned(x, y), 2) / (kSide * kSide);
    }
  }
  EXPECT_LT(std::sqrt(squares), 0.005);
}

// A step in the radiance that moves by a fifth of a pixel changes the pixels beside it.
TEST(Disturbances, MoveWhatTheRadianceRises) {
  constexpr double kMoved = 0.2, kEdge = 20;
  const auto step = [](double x) { return 2 + std::tanh((x - kEdge) / 2); };
  testing::Gaussian1D gaussian(7);
  RenderedChange moved{.more = {}, .less = {}, .apart = 4};
  moved.motion.assign(size_t{kSide} * kSide, {static_cast<float>(kMoved), 0.0F});
  for (int e = 0; e < kEstimates; ++e) {
    for (const double sign : {0.5, -0.5}) {
      std::vector<float> image;
      for (int y = 0; y < kSide; ++y) {
        for (int x = 0; x < kSide; ++x) {
          const double radiance = step(x - sign * moved.apart * kMoved);
          image.push_back(static_cast<float>(radiance * (1 + 0.05 * gaussian())));
        }
      }
      (sign > 0 ? moved.more : moved.less).push_back(image);
    }
  }
  const std::vector<std::vector<float>> found = disturbances_of(
      std::vector{moved}, std::vector<float>(size_t{kSide} * kSide, 1), kSide, surface());
  ASSERT_EQ(found.size(), 1U);
  const double sign = found[0][kSide * 5 + 20] < 0 ? 1 : -1;
  double squares = 0, of_truth = 0;
  for (int y = 1; y + 1 < kSide; ++y) {
    for (int x = 1; x + 1 < kSide; ++x) {
      const double truth = (step(x - kMoved) - step(x)) / step(x);
      squares += std::pow(sign * double{found[0][static_cast<size_t>(y * kSide + x)]} - truth, 2);
      of_truth += truth * truth;
    }
  }
  EXPECT_LT(std::sqrt(squares / of_truth), 0.3);
}

TEST(Disturbances, AreNoneWhereNothingChanges) {
  const auto nothing = [](int, int) { return 0.0; };
  const std::vector<RenderedChange> changes{change(nothing, 4, 1), change(nothing, 2, 2)};
  EXPECT_TRUE(
      disturbances_of(changes, std::vector<float>(size_t{kSide} * kSide, 1), kSide, surface())
          .empty());
}

}  // namespace
}  // namespace itn
