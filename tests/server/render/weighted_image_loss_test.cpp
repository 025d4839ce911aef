#include "server/render/weighted_image_loss.h"

#include <cmath>
#include <random>

#include <gmock/gmock.h>

#include "common/error.h"

namespace itn {
namespace {

constexpr size_t kPixels = 12;
using Parameters = std::array<double, 3>;

// A renderer that is a quadratic in three parameters, pixel by pixel, with noise: radiance and
// derivatives of one estimate have common noise, as those of a path do.
struct SyntheticRenderer {
  static double radiance(const Parameters& pi, size_t p) {
    const double u = static_cast<double>(p) / kPixels;
    return 1 + u * pi[0] + std::sin(3 * u) * pi[1] * pi[1] + u * u * pi[0] * pi[2];
  }
  static double derivative(const Parameters& pi, size_t p, size_t i) {
    const double u = static_cast<double>(p) / kPixels;
    const Parameters d{u + u * u * pi[2], 2 * std::sin(3 * u) * pi[1], u * u * pi[0]};
    return d[i];
  }

  static RenderEstimate estimate(const Parameters& pi, double noise, std::mt19937_64& random) {
    RenderEstimate result;
    result.derivatives.resize(3);
    std::normal_distribution<double> normal(0, noise);
    for (size_t p = 0; p < kPixels; ++p) {
      const double common = normal(random);
      result.radiance.push_back(static_cast<float>(radiance(pi, p) + common));
      for (size_t i = 0; i < 3; ++i) {
        result.derivatives[i].push_back(
            static_cast<float>(derivative(pi, p, i) + 0.7 * common + 0.3 * normal(random)));
      }
    }
    return result;
  }
};

struct Input {
  std::vector<float> image, weight;
};

Input input() {
  Input result;
  for (size_t p = 0; p < kPixels; ++p) {
    result.image.push_back(static_cast<float>(SyntheticRenderer::radiance({0.5, 0.8, 0.1}, p)));
    result.weight.push_back(static_cast<float>(p % 4) / 3);
  }
  return result;
}

double exact_loss(const Input& in, const Parameters& pi) {
  double loss = 0, energy = 0;
  for (size_t p = 0; p < kPixels; ++p) {
    loss += std::pow(in.weight[p] * (in.image[p] - SyntheticRenderer::radiance(pi, p)), 2);
    energy += std::pow(in.weight[p] * in.image[p], 2);
  }
  return loss / energy;
}

Parameters exact_gradient(const Input& in, const Parameters& pi) {
  constexpr double kStep = 1e-5;
  Parameters gradient;
  for (size_t i = 0; i < 3; ++i) {
    Parameters up = pi, down = pi;
    up[i] += kStep;
    down[i] -= kStep;
    gradient[i] = (exact_loss(in, up) - exact_loss(in, down)) / (2 * kStep);
  }
  return gradient;
}

// z-scores of value and gradient over many draws. The bound of 4.5 is exceeded by chance in fewer
// than one of 30,000 runs of all tests here.
constexpr double kBound = 4.5;
std::array<double, 4> z_scores(size_t estimates, bool same_samples) {
  constexpr int kDraws = 20000;
  const Input in = input();
  const Parameters pi{0.3, 0.6, 0.4};
  const Parameters gradient = exact_gradient(in, pi);
  const std::array<double, 4> truth{exact_loss(in, pi), gradient[0], gradient[1], gradient[2]};
  std::mt19937_64 random(1);
  std::array<double, 4> sum{}, squares{};
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<RenderEstimate> drawn;
    for (size_t k = 0; k < estimates; ++k) {
      drawn.push_back(same_samples && k > 0 ? drawn[0]
                                            : SyntheticRenderer::estimate(pi, 0.5, random));
    }
    const LossWithGradient loss = weighted_image_loss(in.image, in.weight, drawn);
    const std::array<double, 4> values{loss.value, loss.gradient[0], loss.gradient[1],
                                       loss.gradient[2]};
    for (size_t i = 0; i < 4; ++i) {
      sum[i] += values[i];
      squares[i] += values[i] * values[i];
    }
  }
  std::array<double, 4> z{};
  for (size_t i = 0; i < 4; ++i) {
    const double mean = sum[i] / kDraws;
    const double variance = squares[i] / kDraws - mean * mean;
    z[i] = (mean - truth[i]) / std::sqrt(variance / kDraws);
  }
  return z;
}

TEST(LossWithGradient, IsUnbiasedFromIndependentEstimates) {
  for (const size_t estimates : {2U, 3U, 4U}) {
    for (const double z : z_scores(estimates, false)) EXPECT_LT(std::abs(z), kBound) << estimates;
  }
}

TEST(LossWithGradient, IsBiasedFromTheSameSamplesTwice) {
  for (const double z : z_scores(2, true)) EXPECT_GT(std::abs(z), 2 * kBound);
}

TEST(LossWithGradient, IsExactWithoutNoise) {
  const Input in = input();
  const Parameters pi{0.3, 0.6, 0.4};
  std::mt19937_64 random(1);
  const std::vector<RenderEstimate> twice(2, SyntheticRenderer::estimate(pi, 1e-12, random));
  const LossWithGradient loss = weighted_image_loss(in.image, in.weight, twice);
  EXPECT_NEAR(loss.value, exact_loss(in, pi), 1e-6);
  const Parameters gradient = exact_gradient(in, pi);
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(loss.gradient[i], gradient[i], 1e-6);
}

TEST(LossWithGradient, OfTwoEstimatesIsTheCrossedProduct) {
  const std::vector<float> image{2}, weight{0.5F};
  const std::vector<RenderEstimate> estimates{{{3}, {{1}, {2}, {3}}, {}},
                                              {{5}, {{4}, {5}, {6}}, {}}};
  const LossWithGradient loss = weighted_image_loss(image, weight, estimates);
  EXPECT_DOUBLE_EQ(loss.value, 1.0 * 3 / 4);
  // [(T_A - I) D_B + (T_B - I) D_A] / I^2.
  EXPECT_DOUBLE_EQ(loss.gradient[0], (1.0 * 4 + 3 * 1) / 4);
  EXPECT_DOUBLE_EQ(loss.gradient[1], (1.0 * 5 + 3 * 2) / 4);
  EXPECT_DOUBLE_EQ(loss.gradient[2], (1.0 * 6 + 3 * 3) / 4);
}

TEST(LossWithGradient, DoesNotDependOnExposure) {
  const Input in = input();
  std::mt19937_64 random(1);
  std::vector<RenderEstimate> estimates{SyntheticRenderer::estimate({0.3, 0.6, 0.4}, 0.5, random),
                                        SyntheticRenderer::estimate({0.3, 0.6, 0.4}, 0.5, random)};
  const LossWithGradient before = weighted_image_loss(in.image, in.weight, estimates);
  const auto scale = [](std::vector<float>& values) {
    for (float& value : values) value *= 8;
  };
  std::vector<float> brighter = in.image;
  scale(brighter);
  for (RenderEstimate& estimate : estimates) {
    scale(estimate.radiance);
    for (auto& derivative : estimate.derivatives) scale(derivative);
  }
  const LossWithGradient after = weighted_image_loss(brighter, in.weight, estimates);
  EXPECT_DOUBLE_EQ(after.value, before.value);
  EXPECT_DOUBLE_EQ(after.gradient[1], before.gradient[1]);
}

TEST(LossWithGradient, RefusesWhatItCannotUse) {
  const std::vector<float> image{2}, weight{1}, black{0};
  const RenderEstimate good{{3}, {{1}, {2}, {3}}, {}};
  const RenderEstimate no_derivative{{3}, {{1}, {2}, {}}, {}};
  const std::vector<RenderEstimate> one{good}, two{good, good}, lacking{good, no_derivative};
  EXPECT_THROW(weighted_image_loss(image, weight, one), Error);
  EXPECT_THROW(weighted_image_loss(image, weight, lacking), Error);
  EXPECT_THROW(weighted_image_loss(black, weight, two), Error);
  EXPECT_NO_THROW(weighted_image_loss(image, weight, two));
}

// Every weighted pixel is worth samples, however black, and no other is.
TEST(LossImportanceTest, FollowsWeightAndImage) {
  const std::vector<float> image{0, 2, 4, 8, -2}, weight{1, 2, 1, 0, 1};
  const std::vector<float> weights = loss_sampling_weights(image, weight);
  const float floor = 0.25F * (0 + 2 + 4 + 2) / 4, most = 4 * (2 + floor);
  EXPECT_THAT(weights,
              ::testing::Pointwise(::testing::FloatEq(), {floor / most, 1.0F, (4 + floor) / most,
                                                          0.0F, (2 + floor) / most}));
  // Far beyond what the square of a float can hold.
  const std::vector<float> wide{1e30F, 1e-30F, 0};
  const std::vector<float> extreme = loss_sampling_weights(std::vector<float>{1, 1, 1}, wide);
  EXPECT_EQ(extreme[0], 1);
  EXPECT_GT(extreme[1], 0);
  EXPECT_EQ(extreme[2], 0);
  EXPECT_THAT(loss_sampling_weights({}, {}), ::testing::IsEmpty());
}

}  // namespace
}  // namespace itn
