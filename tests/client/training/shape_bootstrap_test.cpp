#include "client/training/shape_bootstrap.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/random.h"

namespace itn {
namespace {

TEST(ShapeBootstrap, ValuesAreThoseOfAllImages) {
  const std::vector<std::string> names = {"a", "b", "a", "c"};
  const ShapeBootstrap shapes(names);
  EXPECT_EQ(shapes.images(), 4U);
  EXPECT_EQ(shapes.shapes(), 3U);
  const std::vector<double> errors = {1, -2, 3, 4};
  EXPECT_DOUBLE_EQ(shapes.root_mean_square(errors).value, std::sqrt(30.0 / 4));
  EXPECT_DOUBLE_EQ(shapes.mean(errors).value, 1.5);
}

TEST(ShapeBootstrap, OneShapeSaysNothingOfOthersAndEqualOnesDoNotDiffer) {
  const ShapeBootstrap one(std::vector<std::string>(5, "a"));
  const Estimate estimate = one.mean(std::vector<double>{1, 2, 3, 4, 5});
  EXPECT_EQ(estimate.low, estimate.value);
  EXPECT_EQ(estimate.high, estimate.value);
}

// Shapes of 10 images each whose errors are one and the same: the mean of n such numbers of
// standard deviation 1 has an interval of +-1.96 / sqrt(n), whatever the number of images; images
// drawn one by one would have one narrower by sqrt(10).
TEST(ShapeBootstrap, IntervalsAreOverShapes) {
  constexpr int kShapes = 200, kImages = 10;
  std::vector<std::string> names;
  std::vector<double> values;
  SplitMix random(3);
  double variance = 0;
  for (int s = 0; s < kShapes; ++s) {
    const double value = (random.uniform() - 0.5) * std::sqrt(12.0);
    variance += value * value / kShapes;
    for (int i = 0; i < kImages; ++i) {
      names.push_back(std::to_string(s));
      values.push_back(value);
    }
  }
  const Estimate estimate = ShapeBootstrap(names).mean(values);
  const double width = 2 * 1.96 * std::sqrt(variance / kShapes);
  // 1000 draws know the ends of the interval within some 5 %.
  EXPECT_NEAR(estimate.high - estimate.low, width, 0.12 * width);
  EXPECT_LT(estimate.low, estimate.value);
  EXPECT_GT(estimate.high, estimate.value);
}

// The draws are the same for both: what all shapes have in common falls out of a ratio.
TEST(ShapeBootstrap, RatiosAreOfTheSameDraws) {
  const std::vector<std::string> names = {"a", "b", "c", "d"};
  const std::vector<std::vector<double>> terms = {{1, 4, 9, 16}, {2, 8, 18, 32}};
  const Estimate ratio = ShapeBootstrap(names).estimate(
      terms, [](std::span<const double> means) { return means[0] / means[1]; });
  EXPECT_DOUBLE_EQ(ratio.low, 0.5);
  EXPECT_DOUBLE_EQ(ratio.high, 0.5);
}

}  // namespace
}  // namespace itn
