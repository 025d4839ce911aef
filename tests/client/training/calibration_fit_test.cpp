#include "client/training/calibration_fit.h"

#include <cmath>
#include <random>
#include <vector>

#include <gmock/gmock.h>

#include "common/learning/gaussian.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

// Truths that are as far from the answers as some widths say, and answers that claim others.
struct World {
  torch::Tensor claimed, outputs, truth;  // images x 9, x 9, x 3

  World(int64_t count, const torch::Tensor& widths) {
    torch::manual_seed(1);
    claimed = 0.5 * torch::randn({count, 9}, torch::kFloat64);
    const torch::Tensor z = torch::randn({count, 3}, torch::kFloat64);
    outputs = calibrated(claimed, widths);
    const torch::Tensor l = 4 * torch::tanh(outputs.slice(1, 3, 6) / 4), a = outputs.slice(1, 6, 9);
    const auto at = [](const torch::Tensor& x, int64_t k) { return x.select(1, k); };
    const torch::Tensor d0 = at(z, 0) * (-at(l, 0)).exp();
    const torch::Tensor d1 = at(z, 1) * (-at(l, 1)).exp() - at(a, 0) * d0;
    const torch::Tensor d2 = at(z, 2) * (-at(l, 2)).exp() - at(a, 1) * d0 - at(a, 2) * d1;
    truth = outputs.slice(1, 0, 3) + torch::stack({d0, d1, d2}, 1);
  }
};

// The logarithm of a standard deviation is known to 1 / sqrt(2 n) from n images, and its slope in
// a number of standard deviation 0.5 to twice that.
TEST(WidthFit, FindsTheWidthsThatTheTruthHas) {
  constexpr int64_t kCount = 40000;
  const double deviation = 1 / std::sqrt(2.0 * kCount);
  const torch::Tensor widths =
      torch::tensor({{-0.3, 0.2, 0.0}, {0.1, 0.0, -0.15}}, torch::kFloat64);
  const World world(kCount, widths);
  const v1::Calibration found = fit_calibration(world.claimed, world.truth);
  for (int k = 0; k < 3; ++k) {
    // Six comparisons; log-precisions are bent a little towards their ends, by up to a tenth here.
    EXPECT_NEAR(found.offset(k), widths[0][k].item<double>(), 5 * deviation);
    EXPECT_NEAR(found.slope(k), widths[1][k].item<double>(), 10 * deviation);
  }
}

TEST(WidthFit, MakesTheTruthLikelier) {
  const World world(2000, torch::tensor({{-0.3, 0.2, 0.0}, {0.1, 0.0, -0.15}}, torch::kFloat64));
  const auto loss = [&](const torch::Tensor& outputs) {
    return negative_log_likelihood(outputs, world.truth).mean().item<double>();
  };
  const v1::Calibration found = fit_calibration(world.claimed, world.truth);
  EXPECT_LT(loss(calibrated(world.claimed, to_tensor(found, 3))),
            loss(world.claimed) - 0.1);  // .15 with the true widths
}

TEST(WidthFit, LeavesWidthsThatAreRightAsTheyAre) {
  constexpr int64_t kCount = 40000;
  const World world(kCount, torch::zeros({2, 3}, torch::kFloat64));
  const v1::Calibration found = fit_calibration(world.claimed, world.truth);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(found.offset(k), 0, 5 / std::sqrt(2.0 * kCount));
    EXPECT_NEAR(found.slope(k), 0, 10 / std::sqrt(2.0 * kCount));
  }
}

// The level of 19 others is their 18th of all 20 places that one more has: nine of ten, exactly.
TEST(ConformalLevel, HoldsNineOfTenFurtherTruths) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform;
  std::vector<double> held;
  for (int repeat = 0; repeat < 40000; ++repeat) {
    std::vector<double> levels(19);
    for (double& level : levels) level = uniform(random);
    held.push_back(uniform(random) <= conformal_level(levels) ? 1 : 0);
  }
  testing::expect_equal(testing::over_batches(held), {0.9, 0}, 5, "nine of ten");
}

TEST(ConformalLevel, TooFewOthersPromiseNothing) {
  EXPECT_EQ(conformal_level(std::vector<double>(8, 0.3)), 1);
  EXPECT_EQ(conformal_level(std::vector<double>(9, 0.3)), 0.3);
}

}  // namespace
}  // namespace itn
