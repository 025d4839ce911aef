#include "common/learning/gaussian.h"

#include <cmath>
#include <numbers>
#include <random>

#include <gmock/gmock.h>

#include "common/error.h"
#include "common/learning/encoder.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {
namespace {

using Outputs = std::array<double, gaussian_outputs(3)>;

constexpr Outputs kWide{0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.5, -0.7, 0.3};
constexpr Outputs kNarrow{-0.5, 0.4, 0.6, 3, 2.5, 2, -0.8, 0.6, 1.1};

torch::Tensor as_tensor(const Outputs& outputs) {
  return torch::tensor(std::vector<double>(outputs.begin(), outputs.end()), torch::kFloat64)
      .unsqueeze(0);
}

double log_precision(double output) {
  return 4 * std::tanh(output / 4);
}

// The lower triangular matrix D T of the header.
torch::Tensor factor(const Outputs& o) {
  torch::Tensor t = torch::eye(3, torch::kFloat64);
  t[1][0] = o[6];
  t[2][0] = o[7];
  t[2][1] = o[8];
  torch::Tensor d = torch::zeros({3, 3}, torch::kFloat64);
  for (int i = 0; i < 3; ++i) d[i][i] = std::exp(log_precision(o[3 + i]));
  return d.matmul(t);
}

TEST(Gaussian, LikelihoodIsThatOfThePrecisionMatrix) {
  for (const Outputs& o : {kWide, kNarrow}) {
    const torch::Tensor target = torch::tensor({{0.2, 0.9, -0.4}}, torch::kFloat64);
    const torch::Tensor d = (target - as_tensor(o).slice(1, 0, 3)).t();
    const torch::Tensor precision = factor(o).t().matmul(factor(o));
    const double expected = 0.5 * d.t().matmul(precision).matmul(d).item<double>() -
                            0.5 * torch::linalg_det(precision).log().item<double>() +
                            1.5 * std::log(2 * std::numbers::pi);
    EXPECT_NEAR(negative_log_likelihood(as_tensor(o), target).item<double>(), expected,
                1e-9 * std::abs(expected));
  }
}

TEST(Gaussian, GradientOfTheLikelihoodAgreesWithFiniteDifferences) {
  const torch::Tensor target = torch::tensor({{0.2, 0.9, -0.4}}, torch::kFloat64);
  for (const Outputs& o : {kWide, kNarrow}) {
    const torch::Tensor leaf = as_tensor(o).requires_grad_();
    negative_log_likelihood(leaf, target).sum().backward();
    for (size_t i = 0; i < o.size(); ++i) {
      constexpr double kStep = 1e-5;
      Outputs up = o, down = o;
      up[i] += kStep;
      down[i] -= kStep;
      const double difference = (negative_log_likelihood(as_tensor(up), target) -
                                 negative_log_likelihood(as_tensor(down), target))
                                    .item<double>() /
                                (2 * kStep);
      EXPECT_NEAR(leaf.grad()[0][static_cast<int64_t>(i)].item<double>(), difference,
                  1e-6 * (1 + std::abs(difference)));
    }
  }
}

TEST(Gaussian, LikelihoodAndGradientAreFiniteForEveryOutput) {
  for (const float extreme : {-1e4F, 1e4F}) {
    const torch::Tensor leaf = torch::full({1, 9}, extreme).requires_grad_();
    const torch::Tensor loss = negative_log_likelihood(leaf, torch::zeros({1, 3}));
    loss.sum().backward();
    EXPECT_TRUE(loss.isfinite().all().item<bool>());
    EXPECT_TRUE(leaf.grad().isfinite().all().item<bool>());
  }
}

// A million independent draws of the Gaussian, by another way: the inverse of its factor.
TEST(Gaussian, PosteriorIsThatOfManyRandomDraws) {
  const v1::Model model = residual_model();
  const AnswerSpace answers(model);
  const OutputSpace& space = answers.channel(0);
  for (const Outputs& o : {kWide, kNarrow}) {
    const Posterior quick = posteriors(answers, o).front();
    constexpr int kDraws = 1000000;
    torch::manual_seed(5);
    const torch::Tensor z = torch::randn({3, kDraws}, torch::kFloat64);
    const torch::Tensor draws =
        (torch::linalg_inv(factor(o)).matmul(z)).t().contiguous() + as_tensor(o).slice(1, 0, 3);
    std::array<std::vector<double>, 6> values;
    const auto rows = draws.accessor<double, 2>();
    for (int64_t i = 0; i < kDraws; ++i) {
      const Material m = space.material({rows[i][0], rows[i][1], rows[i][2]});
      const std::array<double, 6> all{m.sigma_t,   m.albedo,    m.g,
                                      m.sigma_a(), m.sigma_s(), m.sigma_s_reduced()};
      for (size_t k = 0; k < 6; ++k) values[k].push_back(all[k]);
    }
    for (size_t group = 0; group < 2; ++group) {
      const JointPosterior& p = group == 0 ? quick.material : quick.scattering;
      std::array<torch::Tensor, 3> v;
      for (size_t k = 0; k < 3; ++k) {
        v[k] = torch::tensor(values[3 * group + k], torch::kFloat64);
        const ParameterPosterior& parameter = p.parameters[k];
        const double sd = v[k].std().item<double>();
        EXPECT_NEAR(parameter.mean, v[k].mean().item<double>(), 0.01 * sd);
        EXPECT_NEAR(parameter.standard_deviation, sd, 0.02 * sd);
        const torch::Tensor sorted = std::get<0>(v[k].sort());
        EXPECT_NEAR(parameter.median, sorted[kDraws / 2].item<double>(), 0.03 * sd);
        EXPECT_NEAR(parameter.low, sorted[kDraws / 20].item<double>(), 0.06 * sd);
        EXPECT_NEAR(parameter.high, sorted[kDraws - kDraws / 20].item<double>(), 0.06 * sd);
      }
      size_t pair = 0;
      for (const auto& [i, j] : {std::pair{0, 1}, {0, 2}, {1, 2}}) {
        const torch::Tensor a = v[i] - v[i].mean(), b = v[j] - v[j].mean();
        const double expected =
            ((a * b).mean() / (a.square().mean() * b.square().mean()).sqrt()).item<double>();
        EXPECT_NEAR(p.correlations[pair++], expected, 0.015);
      }
    }
    EXPECT_EQ(quick.mean().sigma_t, quick.material.parameters[0].mean);
  }
}

// Truths drawn from the Gaussians that a network answers fall into their 90 % intervals nine times
// in ten: of sigma_t, albedo and g, of what is derived from them, and of all three together.
TEST(Gaussian, NinetyPercentIntervalsHoldNinetyPercent) {
  const AnswerSpace answers(residual_model());
  const OutputSpace& space = answers.channel(0);
  constexpr int kTruths = 3000;
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::array<int, 9> inside{};
  for (int i = 0; i < kTruths; ++i) {
    // Precise enough to end nowhere at the bounds, where a truth may lie on the interval's end.
    Outputs o{0.3 * normal(random),
              0.3 * normal(random),
              0.3 * normal(random),
              1.5 + 0.3 * normal(random),
              1.5 + 0.3 * normal(random),
              1.5 + 0.3 * normal(random),
              normal(random),
              normal(random),
              normal(random)};
    const torch::Tensor z =
        torch::tensor({{normal(random)}, {normal(random)}, {normal(random)}}, torch::kFloat64);
    const torch::Tensor d = torch::linalg_inv(factor(o)).matmul(z);
    const auto at = [&](int k) { return o[static_cast<size_t>(k)] + d[k][0].item<double>(); };
    const Material truth = space.material({at(0), at(1), at(2)});
    const std::array<double, 6> values{truth.sigma_t,   truth.albedo,    truth.g,
                                       truth.sigma_a(), truth.sigma_s(), truth.sigma_s_reduced()};
    const Posterior p = posteriors(answers, o).front();
    for (size_t k = 0; k < 6; ++k) {
      const auto& parameter = (k < 3 ? p.material : p.scattering).parameters[k % 3];
      inside[k] += parameter.low <= values[k] && values[k] <= parameter.high ? 1 : 0;
    }
    const auto holds = [](const ParameterPosterior& parameter, double value) {
      return parameter.low <= value && value <= parameter.high ? 1 : 0;
    };
    inside[6] += holds(p.diffuse_albedo, diffuse_albedo(truth));
    inside[7] += holds(p.diffusion_length, diffusion_length(truth));
    const torch::Tensor target = torch::tensor({{at(0), at(1), at(2)}}, torch::kFloat64);
    inside[8] += region_probability(as_tensor(o), target).item<double>() <= 0.9 ? 1 : 0;
  }
  for (const int count : inside) {  // 5 standard errors of the count, and the points' own error
    EXPECT_NEAR(static_cast<double>(count) / kTruths, 0.9, 0.03);
  }
}

// An interval of the level that reaches a truth ends at the truth, between two of 2048 points.
TEST(Gaussian, LevelsReachTheTruth) {
  const AnswerSpace answers(residual_model());
  const Material truth = answers.channel(0).material({0.5, -0.4, 0.9});
  const std::vector<double> outputs(kWide.begin(), kWide.end());
  const IntervalLevels levels = levels_that_reach(answers, outputs, {&truth, 1}).front();
  const Posterior p = posteriors(answers, outputs, levels).front();
  const auto expect_end = [](const ParameterPosterior& of, double value) {
    const double end = std::min(std::abs(of.low - value), std::abs(of.high - value));
    EXPECT_LT(end, 0.01 * of.standard_deviation);
  };
  expect_end(p.material.parameters[0], truth.sigma_t);
  expect_end(p.material.parameters[1], truth.albedo);
  expect_end(p.material.parameters[2], truth.g);
  expect_end(p.scattering.parameters[0], truth.sigma_a());
  expect_end(p.scattering.parameters[1], truth.sigma_s());
  expect_end(p.scattering.parameters[2], truth.sigma_s_reduced());
  expect_end(p.diffuse_albedo, diffuse_albedo(truth));
  expect_end(p.diffusion_length, diffusion_length(truth));
  // Nothing else of the answer depends on levels.
  const Posterior nominal = posteriors(answers, outputs).front();
  EXPECT_EQ(p.mean().sigma_t, nominal.mean().sigma_t);
  EXPECT_EQ(p.material.correlations, nominal.material.correlations);
}

TEST(Gaussian, IntervalLevelsOfAModelAreEightProbabilitiesOrNone) {
  v1::Calibration calibration;
  EXPECT_EQ(interval_levels(calibration), nominal_levels());
  for (size_t k = 0; k < kPosteriorNumbers; ++k) calibration.add_interval_level(0.5);
  EXPECT_EQ(interval_levels(calibration)[7], 0.5);
  calibration.set_interval_level(3, 1);
  EXPECT_THROW(interval_levels(calibration), Error);
  calibration.clear_interval_level();
  calibration.add_interval_level(0.5);
  EXPECT_THROW(interval_levels(calibration), Error);
}

// A Gaussian with the mean (1, 0) and the covariance ((4, 1.2), (1.2, 1)), seen from its own
// margins.
TEST(Gaussian, MarginalProbabilityIsThatOfEachCoordinateAlone) {
  const torch::Tensor covariance =
      torch::tensor({{4.0, 1.2, 0.0}, {1.2, 1.0, 0.0}, {0.0, 0.0, 0.25}}, torch::kFloat64);
  const torch::Tensor mean = torch::tensor({1.0, 0.0, -1.0}, torch::kFloat64);
  const std::vector<double> outputs = to_outputs({mean, at::linalg_inv(covariance)});
  const torch::Tensor row = torch::tensor(outputs, torch::kFloat64).unsqueeze(0);
  const torch::Tensor target = torch::tensor({{3.0, -1.0, -1.0}}, torch::kFloat64);
  const torch::Tensor p = marginal_probability(row, target);
  EXPECT_NEAR(p[0][0].item<double>(), 0.8413447, 1e-6);
  EXPECT_NEAR(p[0][1].item<double>(), 0.1586553, 1e-6);
  EXPECT_NEAR(p[0][2].item<double>(), 0.5, 1e-6);
}

TEST(Gaussian, PosteriorIsTheSameEveryTimeAndStaysInsideTheBounds) {
  const v1::Model model = residual_model();
  const AnswerSpace space(model);
  const Box box = to_box(model.bounds());
  Outputs hopeless{};
  for (size_t i = 3; i < 6; ++i) hopeless[i] = -50;
  Outputs far{};
  far.fill(1e6);
  for (const Outputs& o : {kWide, hopeless, far}) {
    const Posterior a = posteriors(space, o).front(), b = posteriors(space, o).front();
    for (size_t k = 0; k < 3; ++k) {
      const ParameterPosterior& p = a.material.parameters[k];
      EXPECT_EQ(p.mean, b.material.parameters[k].mean);
      EXPECT_LE(box.min[k], p.low);
      EXPECT_LE(p.low, p.mean + 1e-9 * box.max[k]);
      EXPECT_LE(p.mean, p.high + 1e-9 * box.max[k]);
      EXPECT_LE(p.high, box.max[k]);
      EXPECT_TRUE(std::isfinite(a.material.correlations[k]));
    }
  }
}

TEST(Gaussian, CorrectedWidthsFollowTheFirstMean) {
  v1::Calibration widths;
  for (const double offset : {0.1, -0.2, 0.3}) widths.add_offset(offset);
  for (const double slope : {0.0, 0.5, -1.0}) widths.add_slope(slope);
  torch::Tensor outputs = torch::arange(1, 10, torch::kFloat64).view({1, 9});
  outputs[0][0] = -2;
  const torch::Tensor expected =
      torch::tensor({-2.0, 2.0, 3.0, 4.1, 3.8, 8.3, 7.0, 8.0, 9.0}, torch::kFloat64).view({1, 9});
  EXPECT_TRUE(torch::allclose(calibrated(outputs, to_tensor(widths, 3)), expected));
}

TEST(Gaussian, ACorrectionOfOtherThanThreeFiniteNumbersIsRefused) {
  v1::Calibration widths;
  EXPECT_THROW(to_tensor(widths, 3), Error);
  for (int k = 0; k < 3; ++k) {
    widths.add_offset(0);
    widths.add_slope(0);
  }
  EXPECT_NO_THROW(to_tensor(widths, 3));
  widths.set_slope(1, NAN);
  EXPECT_THROW(to_tensor(widths, 3), Error);
}

TEST(Gaussian, PosteriorOfWhatIsNotFiniteIsRefused) {
  Outputs o = kWide;
  o[7] = NAN;
  EXPECT_THROW(posteriors(AnswerSpace(residual_model()), o), Error);
  EXPECT_THROW(posteriors(AnswerSpace(residual_model()), std::vector<double>(8)), Error);
}

// --- In colour ---

// Of coordinates whose means and deviations are all different.
v1::Model colour_model() {
  v1::Model model = residual_model();
  model.set_channels(3);
  model.clear_mean();
  model.clear_standard_deviation();
  for (const double mean : {4.0, 4.2, 3.9, 1.5, 1.0, 0.5, 0.2}) model.add_mean(mean);
  for (const double sd : {0.5, 0.6, 0.4, 0.7, 0.8, 0.9, 1.1}) model.add_standard_deviation(sd);
  return model;
}

std::vector<double> colour_outputs() {
  std::vector<double> outputs(gaussian_outputs(7));
  for (size_t k = 0; k < outputs.size(); ++k) {
    outputs[k] = 0.4 * std::sin(3.0 * static_cast<double>(k)) + (k >= 7 && k < 14 ? 1 : 0);
  }
  return outputs;
}

TEST(ColourGaussian, LikelihoodIsThatOfThePrecisionMatrix) {
  const std::vector<double> outputs = colour_outputs();
  const Gaussian gaussian = to_gaussian(outputs);
  const torch::Tensor target =
      torch::tensor({{0.2, 0.9, -0.4, 0.1, -0.3, 0.6, 0.5}}, torch::kFloat64);
  const torch::Tensor d = target[0] - gaussian.mean;
  const double expected = 0.5 * d.dot(gaussian.precision.mv(d)).item<double>() -
                          0.5 * torch::linalg_det(gaussian.precision).log().item<double>() +
                          3.5 * std::log(2 * std::numbers::pi);
  const torch::Tensor row = torch::tensor(outputs, torch::kFloat64).unsqueeze(0);
  EXPECT_NEAR(negative_log_likelihood(row, target).item<double>(), expected,
              1e-9 * std::abs(expected));
}

// Two hundred thousand random draws of the Gaussian, by its covariance.
TEST(ColourGaussian, PosteriorsAreThoseOfManyRandomDraws) {
  const AnswerSpace space(colour_model());
  const std::vector<double> outputs = colour_outputs();
  const std::vector<Posterior> quick = posteriors(space, outputs);
  ASSERT_EQ(quick.size(), 3);
  constexpr int64_t kDraws = 200000;
  const Gaussian gaussian = to_gaussian(outputs);
  const torch::Tensor root = at::linalg_cholesky(at::linalg_inv(gaussian.precision));
  torch::manual_seed(5);
  const torch::Tensor draws =
      torch::randn({kDraws, 7}, torch::kFloat64).matmul(root.t()).add(gaussian.mean).contiguous();
  std::array<std::array<torch::Tensor, 3>, 3> values;
  for (auto& channel : values) {
    for (torch::Tensor& parameter : channel) parameter = torch::empty({kDraws}, torch::kFloat64);
  }
  for (int64_t i = 0; i < kDraws; ++i) {
    const double* row = draws[i].data_ptr<double>();
    const std::vector<Material> materials = space.materials({row, 7});
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(materials[c].g, materials[0].g);
      values[c][0].data_ptr<double>()[i] = materials[c].sigma_t;
      values[c][1].data_ptr<double>()[i] = materials[c].albedo;
      values[c][2].data_ptr<double>()[i] = materials[c].g;
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    for (size_t k = 0; k < 3; ++k) {
      const ParameterPosterior& p = quick[c].material.parameters[k];
      const double sd = values[c][k].std().item<double>();
      EXPECT_NEAR(p.mean, values[c][k].mean().item<double>(), 0.02 * sd) << c << ", " << k;
      EXPECT_NEAR(p.standard_deviation, sd, 0.03 * sd) << c << ", " << k;
      const torch::Tensor sorted = std::get<0>(values[c][k].sort());
      EXPECT_NEAR(p.low, sorted[kDraws / 20].item<double>(), 0.08 * sd) << c << ", " << k;
      EXPECT_NEAR(p.high, sorted[kDraws - kDraws / 20].item<double>(), 0.08 * sd) << c << ", " << k;
    }
  }
}

// Three Gaussians over three coordinates, of unequal weights, and apart from each other.
std::vector<double> mixture() {
  std::vector<double> outputs(kWide.begin(), kWide.end());
  outputs.insert(outputs.end(), kNarrow.begin(), kNarrow.end());
  for (size_t k = 0; k < kWide.size(); ++k) outputs.push_back(k < 3 ? -2 : kWide[k] / 2);
  for (const double logit : {0.0, 1.0, -0.5}) outputs.push_back(logit);
  return outputs;
}

torch::Tensor row_of(const std::vector<double>& outputs) {
  return torch::tensor(outputs, torch::kFloat64).unsqueeze(0);
}

// Draws, one a row.
torch::Tensor draws_of(const std::vector<double>& outputs, int64_t count) {
  torch::manual_seed(7);
  const torch::Tensor weights = torch::softmax(row_of(outputs)[0].slice(0, 27), 0);
  const torch::Tensor which = torch::multinomial(weights, count, true);
  torch::Tensor draws = torch::randn({count, 3}, torch::kFloat64);
  for (int64_t k = 0; k < 3; ++k) {
    const Gaussian one = to_gaussian({outputs.data() + 9 * k, 9});
    const torch::Tensor root = at::linalg_cholesky(at::linalg_inv(one.precision));
    const torch::Tensor of_one = draws.matmul(root.t()) + one.mean;
    draws = torch::where((which == k).unsqueeze(1), of_one, draws);
  }
  return draws;
}

TEST(Mixture, HasTheDensityOfItsGaussians) {
  const std::vector<double> outputs = mixture();
  ASSERT_EQ(outputs.size(), mixture_outputs(3, 3));
  EXPECT_EQ(mixture_components(outputs.size(), 3), 3U);
  const torch::Tensor target = torch::tensor({{-0.3, 0.2, 0.5}}, torch::kFloat64);
  const torch::Tensor weights = torch::softmax(row_of(outputs)[0].slice(0, 27), 0);
  double density = 0;
  for (int64_t k = 0; k < 3; ++k) {
    const torch::Tensor one = row_of(outputs).slice(1, 9 * k, 9 * k + 9);
    density +=
        weights[k].item<double>() * std::exp(-negative_log_likelihood(one, target).item<double>());
  }
  EXPECT_NEAR(negative_log_likelihood(row_of(outputs), target).item<double>(), -std::log(density),
              1e-12);
  // Of a batch, each row is by itself.
  const torch::Tensor two = torch::cat({row_of(outputs), row_of(outputs)});
  const torch::Tensor targets = torch::cat({target, target + 1});
  EXPECT_NEAR(negative_log_likelihood(two, targets)[0].item<double>(), -std::log(density), 1e-12);
  EXPECT_NE(negative_log_likelihood(two, targets)[1].item<double>(), -std::log(density));
}

TEST(Mixture, OfOneGaussianSeveralTimesIsThatOne) {
  std::vector<double> outputs;
  for (int k = 0; k < 4; ++k) outputs.insert(outputs.end(), kWide.begin(), kWide.end());
  outputs.insert(outputs.end(), {0.3, -1, 2, 0});
  const torch::Tensor target = torch::tensor({{0.2, 0.9, -0.4}}, torch::kFloat64);
  const torch::Tensor one = as_tensor(kWide), all = row_of(outputs);
  EXPECT_NEAR(negative_log_likelihood(all, target).item<double>(),
              negative_log_likelihood(one, target).item<double>(), 1e-12);
  EXPECT_TRUE(torch::allclose(mean_of(all, 3), mean_of(one, 3)));
  EXPECT_TRUE(
      torch::allclose(marginal_probability(all, target), marginal_probability(one, target)));
  EXPECT_NEAR(region_probability(all, target).item<double>(),
              region_probability(one, target).item<double>(), 0.02);
  const Gaussian same = to_gaussian(outputs, 3), expected = to_gaussian(kWide);
  EXPECT_TRUE(torch::allclose(same.mean, expected.mean));
  EXPECT_TRUE(torch::allclose(same.precision, expected.precision));
  const AnswerSpace space(residual_model());
  const Posterior a = posteriors(space, outputs).front(), b = posteriors(space, kWide).front();
  for (size_t i = 0; i < 3; ++i) {
    const ParameterPosterior &p = a.material.parameters[i], &q = b.material.parameters[i];
    EXPECT_NEAR(p.mean, q.mean, 0.02 * q.standard_deviation);
    EXPECT_NEAR(p.low, q.low, 0.05 * q.standard_deviation);
    EXPECT_NEAR(p.high, q.high, 0.1 * q.standard_deviation);
  }
}

// Of many random draws, nine of ten are where it says; so are their mean and covariance.
TEST(Mixture, SaysWhereItsDrawsAre) {
  const std::vector<double> outputs = mixture();
  constexpr int64_t kDraws = 4000;
  const torch::Tensor draws = draws_of(outputs, kDraws);
  const torch::Tensor each = row_of(outputs).expand({kDraws, -1});
  const torch::Tensor regions = region_probability(each.slice(0, 0, 500), draws.slice(0, 0, 500));
  EXPECT_NEAR((regions < 0.9).to(torch::kFloat64).mean().item<double>(), 0.9, 0.05);
  EXPECT_NEAR((regions < 0.5).to(torch::kFloat64).mean().item<double>(), 0.5, 0.08);
  const torch::Tensor marginals = marginal_probability(each, draws);
  for (int64_t k = 0; k < 3; ++k) {
    const torch::Tensor below = (marginals.select(1, k) < 0.2).to(torch::kFloat64);
    EXPECT_NEAR(below.mean().item<double>(), 0.2, 0.025);
  }
  const Gaussian alike = to_gaussian(outputs, 3);
  const torch::Tensor d = draws - draws.mean(0);
  const torch::Tensor covariance = d.t().matmul(d) / static_cast<double>(kDraws);
  EXPECT_TRUE(torch::allclose(draws.mean(0), alike.mean, 0, 0.1));
  EXPECT_TRUE(torch::allclose(covariance, at::linalg_inv(alike.precision), 0.1, 0.1));
  EXPECT_TRUE(torch::allclose(mean_of(row_of(outputs), 3)[0], alike.mean));
  const AnswerSpace space(residual_model());
  const Posterior posterior = posteriors(space, outputs).front();
  int inside = 0;
  for (int64_t i = 0; i < kDraws; ++i) {
    const Material m = space.materials({draws[i].data_ptr<double>(), 3}).front();
    const ParameterPosterior& p = posterior.material.parameters[2];  // hardly any are at its bounds
    inside += m.g >= p.low && m.g <= p.high ? 1 : 0;
  }
  EXPECT_NEAR(inside / static_cast<double>(kDraws), 0.9, 0.025);
}

TEST(Mixture, OtherWidthsAreThoseOfEachGaussian) {
  const std::vector<double> outputs = mixture();
  v1::Calibration widths;
  for (const double x : {0.1, -0.2, 0.3}) widths.add_offset(x);
  for (const double x : {0.5, 0.0, -0.5}) widths.add_slope(x);
  const torch::Tensor changed = calibrated(row_of(outputs), to_tensor(widths, 3));
  for (int64_t k = 0; k < 3; ++k) {
    const torch::Tensor one = row_of(outputs).slice(1, 9 * k, 9 * k + 9);
    EXPECT_TRUE(
        torch::allclose(changed.slice(1, 9 * k, 9 * k + 9), calibrated(one, to_tensor(widths, 3))));
  }
  EXPECT_TRUE(torch::equal(changed.slice(1, 27), row_of(outputs).slice(1, 27)));
}

TEST(Mixture, RefusesNumbersThatAreNone) {
  for (const size_t outputs : {0U, 8U, 10U, 19U, 21U}) {
    EXPECT_THROW(mixture_components(outputs, 3), Error) << outputs;
  }
  v1::Model model = residual_model();
  model.set_components(17);
  EXPECT_THROW(output_count(model), Error);
  model.set_components(2);
  EXPECT_EQ(output_count(model), 20);
}

}  // namespace
}  // namespace itn
