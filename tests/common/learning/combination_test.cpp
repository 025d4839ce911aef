#include "common/learning/combination.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include "common/error.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using Numbers = std::vector<double>;

const Numbers kOne{0.3, -0.2, 0.1, 1.4, 1.3, 1.2, 0.5, -0.7, 0.3};
const Numbers kOther{-0.5, 0.4, 0.6, 1.8, 1.1, 2, -0.8, 0.6, 0.4};

double distance(const torch::Tensor& a, const torch::Tensor& b) {
  return (a - b).abs().max().item<double>();
}

TEST(Gaussian, ThereAndBackAgain) {
  Numbers seven(gaussian_outputs(7));
  for (size_t k = 0; k < seven.size(); ++k) seven[k] = std::sin(3.0 * static_cast<double>(k));
  for (const Numbers& outputs : {kOne, kOther, seven}) {
    const Numbers back = to_outputs(to_gaussian(outputs));
    for (size_t k = 0; k < outputs.size(); ++k) EXPECT_NEAR(back[k], outputs[k], 1e-9) << k;
  }
}

// Materials as the prior says, seen twice through known Gaussian noise: the combination is the
// posterior of both, which holds the truth as often as it says, and the one of either does, too.
TEST(Combination, IsThePosteriorOfAllImages) {
  v1::Model model = residual_model();
  const Combination combination(model);
  // What the combination takes for the prior is what it makes of images that tell nothing: of n
  // answers that are the prior, the prior.
  const OutputSpace space(model);
  std::vector<MaterialCoordinates> truths;
  torch::Tensor z = torch::empty({4000, 3}, torch::kFloat64);
  torch::manual_seed(2);
  const torch::Tensor uniform = torch::rand({4000, 3}, torch::kFloat64);
  const Box range = to_box(paper_range());
  for (int64_t i = 0; i < z.size(0); ++i) {
    const auto between = [&](int64_t k, double min, double max) {
      return min + (max - min) * uniform[i][k].item<double>();
    };
    const MaterialCoordinates coordinates = space.standardized(
        {std::exp(between(0, std::log(range.min[0]), std::log(range.max[0]))),
         between(1, range.min[1], range.max[1]), between(2, range.min[2], range.max[2])});
    for (int64_t k = 0; k < 3; ++k) z[i][k] = coordinates[static_cast<size_t>(k)];
  }
  const torch::Tensor mean = z.mean(0), d = z - mean;
  const torch::Tensor prior = at::linalg_inv(d.t().matmul(d) / 4000);
  const torch::Tensor noise = torch::diag(torch::tensor({4.0, 6.0, 2.0}, torch::kFloat64));
  const auto answer = [&](const torch::Tensor& measured) {
    const torch::Tensor precision = prior + noise;
    const torch::Tensor information = prior.matmul(mean) + noise.matmul(measured);
    return ImageAnswer{to_outputs({at::linalg_solve(precision, information), precision}), 1};
  };
  const torch::Tensor first = mean + torch::tensor({0.3, -0.5, 0.4}, torch::kFloat64);
  const torch::Tensor second = mean + torch::tensor({-0.1, 0.2, 0.9}, torch::kFloat64);
  const Gaussian both =
      to_gaussian(combination(std::vector<ImageAnswer>{answer(first), answer(second)}));
  const torch::Tensor precision = prior + 2 * noise;
  const torch::Tensor expected =
      at::linalg_solve(precision, prior.matmul(mean) + noise.matmul(first) + noise.matmul(second));
  // The prior of the combination is one of other points of the same distribution.
  EXPECT_LT(distance(both.mean, expected), 0.02);
  EXPECT_LT(distance(both.precision, precision), 0.05 * precision.max().item<double>());
}

// The correlations of materials whose colours are alike.
void set_correlation(double of_colours, v1::Model& model) {
  for (int i = 0; i < 7; ++i) {
    for (int j = 0; j < 7; ++j) {
      model.add_correlation(i == j ? 1 : i / 3 == j / 3 && i < 6 && j < 6 ? of_colours : 0);
    }
  }
}

// In colour the prior is what the model says of its training; an object twice as large moves all
// three of the first coordinates.
TEST(Combination, InColourIsThePosteriorOfAllImages) {
  v1::Model model = residual_model(32, v1::EXPOSURE_UNKNOWN, 3);
  set_correlation(0.6, model);
  torch::Tensor covariance = torch::empty({7, 7}, torch::kFloat64);
  for (int64_t k = 0; k < 49; ++k)
    covariance.view({49})[k] = model.correlation(static_cast<int>(k));
  const torch::Tensor prior = at::linalg_inv(covariance);
  const torch::Tensor noise = torch::diag(torch::linspace(1, 4, 7, torch::kFloat64));
  const auto answer = [&](const torch::Tensor& measured, double size) {
    const torch::Tensor precision = prior + noise;
    return ImageAnswer{to_outputs({at::linalg_solve(precision, noise.matmul(measured)), precision}),
                       size};
  };
  const torch::Tensor first = torch::linspace(-0.5, 0.7, 7, torch::kFloat64);
  const torch::Tensor second = first.flip(0) + 0.1;
  const auto both_of = [&](double size) {
    return to_gaussian(
        Combination(model)(std::vector<ImageAnswer>{answer(first, 1), answer(second, size)}));
  };
  const Gaussian both = both_of(1);
  const torch::Tensor precision = prior + 2 * noise;
  EXPECT_LT(distance(both.precision, precision), 2e-3 * precision.max().item<double>());
  EXPECT_LT(distance(both.mean, at::linalg_solve(precision, noise.matmul(first + second))), 2e-3);
  // What the second image says, and what was known before it, are of another size.
  torch::Tensor shift = torch::zeros({7}, torch::kFloat64);
  for (int k = 0; k < 3; ++k) shift[k] = -std::log(2.0) / model.standard_deviation(k);
  const torch::Tensor moved = at::linalg_solve(precision, noise.matmul(first + second + shift));
  EXPECT_LT(distance(both_of(2).mean, moved), 2e-3);
}

TEST(Combination, TakesNoPriorThatIsNone) {
  const v1::Model gray = residual_model(32, v1::EXPOSURE_UNKNOWN, 3);
  testing::expect_error(ErrorKind::kInvalidInput, {"model.correlation has 0 numbers", "have 49"},
                        [&] { Combination{gray}; });
  for (const double wrong : {1.5, std::numeric_limits<double>::quiet_NaN()}) {
    v1::Model model = gray;
    set_correlation(wrong, model);
    testing::expect_error(ErrorKind::kInvalidInput, {"not that of a distribution"},
                          [&] { Combination{model}; });
  }
  v1::Model alike = gray;  // all media are gray
  set_correlation(1, alike);
  EXPECT_NO_THROW(Combination{alike});
}

TEST(Combination, OfOneImageIsItsAnswer) {
  const Combination combination(residual_model());
  EXPECT_EQ(combination(std::vector<ImageAnswer>{{kOne, 3}}), kOne);
}

TEST(Combination, OfErrorsThatAllImagesShareIsNoSurerThanOne) {
  v1::Model model = residual_model();
  model.set_error_correlation(1);
  const std::vector<ImageAnswer> same(5, {kOne, 1});
  const Gaussian one = to_gaussian(kOne), all = to_gaussian(Combination(model)(same));
  EXPECT_LT(distance(all.mean, one.mean), 1e-9);
  EXPECT_LT(distance(all.precision, one.precision), 1e-9);
  model.set_error_correlation(0);
  const Gaussian surer = to_gaussian(Combination(model)(same));
  EXPECT_GT(torch::linalg_det(surer.precision).item<double>(),
            20 * torch::linalg_det(one.precision).item<double>());
}

// A material is another number per longest side of an object twice as large.
TEST(Combination, MovesAnswersForOtherSizes) {
  const v1::Model model = residual_model();
  const Combination combination(model);
  Numbers larger = kOne;
  larger[0] += std::log(2) / model.standard_deviation(0);
  const Gaussian alike = to_gaussian(combination(std::vector<ImageAnswer>{{kOne, 1}, {kOne, 1}}));
  const Gaussian sizes = to_gaussian(combination(std::vector<ImageAnswer>{{kOne, 1}, {larger, 2}}));
  // But for what the prior expects of either.
  EXPECT_NEAR(sizes.mean[0].item<double>(), alike.mean[0].item<double>(), 0.15);
  EXPECT_LT(distance(sizes.precision, alike.precision), 1e-9);
}

TEST(Combination, StaysADistributionWhereImagesTellLessThanNothing) {
  Numbers vague(9);
  vague[3] = vague[4] = vague[5] = -2;  // wider than the prior
  const Combination combination(residual_model());
  const Gaussian all = to_gaussian(combination(std::vector<ImageAnswer>(6, ImageAnswer{vague, 1})));
  EXPECT_GT(std::get<0>(at::linalg_eigh(all.precision)).min().item<double>(), 0);
}

// Far from the middle of the prior, answers no surer than it say that it is wider there than the
// Gaussian that stands for it. Taking that out of them would move what they agree about.
TEST(Combination, StaysWhereWideAnswersAgree) {
  Numbers wide{3, -2, 2, -1, -1, -1, 0, 0, 0};
  const Combination combination(residual_model());
  const Gaussian one = to_gaussian(wide);
  const Gaussian all = to_gaussian(combination(std::vector<ImageAnswer>(4, ImageAnswer{wide, 1})));
  EXPECT_LT(distance(all.mean, one.mean), 1e-6);
  EXPECT_LT(distance(all.precision, one.precision), 1e-6);
}

// So they do for an object of another size, of which they say another number.
TEST(Combination, StaysWhereWideAnswersAgreeAboutOtherSizes) {
  const v1::Model model = residual_model();
  const Numbers wide{3, -2, 2, -1, -1, -1, 0, 0, 0};
  Numbers of_half = wide;
  of_half[0] += std::log(0.5) / model.standard_deviation(0);
  const Gaussian all = to_gaussian(
      Combination(model)(std::vector<ImageAnswer>{{wide, 1}, {of_half, 0.5}, {of_half, 0.5}}));
  EXPECT_LT(distance(all.mean, to_gaussian(wide).mean), 1e-6);
}

// Answers that are hardly surer than the prior cannot all be three of its deviations away from its
// middle, were it a Gaussian.
TEST(Combination, GoesNoFartherThanAGaussianPriorLets) {
  const v1::Model model = residual_model();
  const Combination combination(model);
  // Four answers that are the prior are the prior.
  const Numbers sure{0, 0, 0, 3, 3, 3, 0, 0, 0};
  const Gaussian narrow = to_gaussian(sure);
  const Gaussian both = to_gaussian(combination(std::vector<ImageAnswer>(2, {sure, 1})));
  const torch::Tensor prior = 2 * narrow.precision - both.precision;
  const torch::Tensor middle = at::linalg_solve(
      prior, 2 * narrow.precision.matmul(narrow.mean) - both.precision.matmul(both.mean));
  const torch::Tensor deviation = at::linalg_inv(prior).diagonal().sqrt();
  const Gaussian one{middle + 3 * deviation, 1.1 * prior};
  const Gaussian all = to_gaussian(combination(std::vector<ImageAnswer>(4, {to_outputs(one), 1})));
  EXPECT_LT(distance(all.mean, one.mean), 1e-3);
  EXPECT_LT(distance(all.precision, 1.4 * prior), 1e-3 * prior.max().item<double>());
}

TEST(Combination, NeedsAModelThatAnswersDistributions) {
  testing::expect_error(ErrorKind::kInvalidInput, {"answers no distributions"},
                        [] { Combination{small_model()}; });
}

}  // namespace
}  // namespace itn
