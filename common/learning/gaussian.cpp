#include "common/learning/gaussian.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "common/error.h"

namespace itn {
namespace {

// Standard deviations of exp(-4) to exp(4) of the prior's: no image tells or hides more.
constexpr double kMaxLogPrecision = 4;

// --- Points ---

constexpr int64_t kPoints = 2048;  // quantiles of 5 % are means of some hundred

// Standard normal points in three dimensions: those of Sobol's net, each in the middle of its cell,
// through the inverse of the normal distribution function; then with mean 0 and covariance 1 to the
// last bits, so that what is linear in them is exact.
std::vector<MaterialCoordinates> normal_points() {
  constexpr int64_t kBits = 30;  // of torch's direction numbers
  torch::Tensor directions = torch::zeros({3, kBits}, torch::kInt64);
  at::_sobol_engine_initialize_state_(directions, 3);
  const torch::Tensor drawn = std::get<0>(at::_sobol_engine_draw(
      torch::zeros({3}, torch::kInt64), kPoints, directions, 3, 0, torch::kFloat64));
  const torch::Tensor cells = (drawn * kPoints).floor();
  const torch::Tensor uniform = (cells + 0.5) / static_cast<double>(kPoints);
  torch::Tensor normal = std::numbers::sqrt2 * torch::erfinv(2 * uniform - 1);
  normal = normal - normal.mean(0);
  const torch::Tensor covariance = normal.t().matmul(normal) / static_cast<double>(kPoints);
  const torch::Tensor root = at::linalg_cholesky(covariance);
  normal = at::linalg_solve(root, normal.t()).t().contiguous();
  std::vector<MaterialCoordinates> points;
  const auto rows = normal.accessor<double, 2>();
  for (int64_t i = 0; i < kPoints; ++i) points.push_back({rows[i][0], rows[i][1], rows[i][2]});
  return points;
}

double log_precision(double output) {
  return kMaxLogPrecision * std::tanh(output / kMaxLogPrecision);
}

// Undoes z = D T d, line by line.
MaterialCoordinates coordinates(std::span<const double, kGaussianOutputs> o,
                                const MaterialCoordinates& z) {
  const double d0 = z[0] * std::exp(-log_precision(o[3]));
  const double d1 = z[1] * std::exp(-log_precision(o[4])) - o[6] * d0;
  const double d2 = z[2] * std::exp(-log_precision(o[5])) - o[7] * d0 - o[8] * d1;
  return {o[0] + d0, o[1] + d1, o[2] + d2};
}

// --- What they say ---

// Values at the points, by parameter.
using Samples = std::array<std::vector<double>, 3>;

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double covariance(const std::vector<double>& a, double mean_a, const std::vector<double>& b,
                  double mean_b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - mean_a) * (b[i] - mean_b);
  return sum / static_cast<double>(a.size());
}

// The quantile of values in any order, between the two that are nearest.
double quantile(std::vector<double> values, double probability) {
  const double place = probability * static_cast<double>(values.size()) - 0.5;
  const auto below = static_cast<ptrdiff_t>(place);
  std::nth_element(values.begin(), values.begin() + below, values.end());
  const double low = values[static_cast<size_t>(below)];
  const double high = *std::min_element(values.begin() + below + 1, values.end());
  return std::lerp(low, high, place - static_cast<double>(below));
}

JointPosterior describe(const Samples& samples) {
  constexpr double kLow = 0.05, kHigh = 0.95;
  JointPosterior result;
  for (size_t i = 0; i < 3; ++i) {
    ParameterPosterior& p = result.parameters[i];
    p.mean = mean_of(samples[i]);
    p.standard_deviation = std::sqrt(covariance(samples[i], p.mean, samples[i], p.mean));
    p.low = quantile(samples[i], kLow);
    p.high = quantile(samples[i], kHigh);
  }
  constexpr std::array<std::array<size_t, 2>, 3> kPairs{{{0, 1}, {0, 2}, {1, 2}}};
  for (size_t pair = 0; pair < 3; ++pair) {
    const auto [i, j] = kPairs[pair];
    const ParameterPosterior &a = result.parameters[i], &b = result.parameters[j];
    const double scale = a.standard_deviation * b.standard_deviation;
    result.correlations[pair] =
        scale > 0 ? covariance(samples[i], a.mean, samples[j], b.mean) / scale : 0;
  }
  return result;
}

}  // namespace

torch::Tensor negative_log_likelihood(const torch::Tensor& outputs, const torch::Tensor& targets) {
  const torch::Tensor d = targets - outputs.slice(1, 0, 3);
  const torch::Tensor l = kMaxLogPrecision * torch::tanh(outputs.slice(1, 3, 6) / kMaxLogPrecision);
  const torch::Tensor a = outputs.slice(1, 6, 9);
  const auto column = [](const torch::Tensor& x, int64_t i) { return x.select(1, i); };
  const torch::Tensor z =
      torch::stack({column(d, 0), column(d, 1) + column(a, 0) * column(d, 0),
                    column(d, 2) + column(a, 1) * column(d, 0) + column(a, 2) * column(d, 1)},
                   1) *
      l.exp();
  const double normalisation = 1.5 * std::log(2 * std::numbers::pi);
  return 0.5 * z.square().sum(1) - l.sum(1) + normalisation;
}

torch::Tensor calibrated(const torch::Tensor& outputs, const torch::Tensor& widths) {
  const torch::Tensor precisions =
      outputs.slice(1, 3, 6) + widths[0] + widths[1] * outputs.slice(1, 0, 1);
  return torch::cat({outputs.slice(1, 0, 3), precisions, outputs.slice(1, 6, 9)}, 1);
}

torch::Tensor to_tensor(const v1::Calibration& widths) {
  torch::Tensor tensor = torch::empty({2, 3}, torch::kFloat64);
  int64_t row = 0;
  for (const auto* numbers : {&widths.offset(), &widths.slope()}) {
    if (numbers->size() != 3 ||
        !std::ranges::all_of(*numbers, [](double x) { return std::isfinite(x); })) {
      throw invalid_input("the model's correction of widths needs three finite numbers of a kind");
    }
    for (int k = 0; k < 3; ++k) tensor[row][k] = numbers->Get(k);
    ++row;
  }
  return tensor;
}

// With T and D as in the header the precision is (D T)^T (D T).
Gaussian to_gaussian(std::span<const double, kGaussianOutputs> o) {
  torch::Tensor t = torch::eye(3, torch::kFloat64);
  t[1][0] = o[6];
  t[2][0] = o[7];
  t[2][1] = o[8];
  const torch::Tensor d = torch::tensor(
      {std::exp(log_precision(o[3])), std::exp(log_precision(o[4])), std::exp(log_precision(o[5]))},
      torch::kFloat64);
  const torch::Tensor root = torch::diag(d).matmul(t);
  return {torch::tensor({o[0], o[1], o[2]}, torch::kFloat64), root.t().matmul(root)};
}

// Cholesky's factor begins with the first coordinate, D T with the last: so both are turned round.
std::array<double, kGaussianOutputs> to_outputs(const Gaussian& gaussian) {
  constexpr double kNearlyMost = 0.9999 * kMaxLogPrecision;
  const torch::Tensor turned = at::linalg_cholesky(gaussian.precision.flip({0, 1}));
  const torch::Tensor root = turned.flip({0, 1}).t().contiguous();  // D T
  const auto r = root.accessor<double, 2>();
  const torch::Tensor means = gaussian.mean.contiguous();
  const auto mean = means.accessor<double, 1>();
  const auto log_precision_output = [&](int64_t k) {
    const double l = std::clamp(std::log(r[k][k]), -kNearlyMost, kNearlyMost);
    return kMaxLogPrecision * std::atanh(l / kMaxLogPrecision);
  };
  return {mean[0],
          mean[1],
          mean[2],
          log_precision_output(0),
          log_precision_output(1),
          log_precision_output(2),
          r[1][0] / r[1][1],
          r[2][0] / r[2][2],
          r[2][1] / r[2][2]};
}

Material Posterior::mean() const {
  const auto& p = material.parameters;
  return {p[0].mean, p[1].mean, p[2].mean};
}

Posterior posterior(const OutputSpace& space, std::span<const double, kGaussianOutputs> outputs) {
  static const std::vector<MaterialCoordinates> points = normal_points();
  if (!std::ranges::all_of(outputs, [](double x) { return std::isfinite(x); })) {
    throw invalid_input("the network's prediction is not finite");
  }
  Samples material, scattering;
  for (const MaterialCoordinates& point : points) {
    const Material m = space.material(coordinates(outputs, point));
    const MaterialCoordinates first{m.sigma_t, m.albedo, m.g};
    const MaterialCoordinates second{m.sigma_a(), m.sigma_s(), m.sigma_s_reduced()};
    for (size_t i = 0; i < 3; ++i) {
      material[i].push_back(first[i]);
      scattering[i].push_back(second[i]);
    }
  }
  return {describe(material), describe(scattering)};
}

}  // namespace itn
