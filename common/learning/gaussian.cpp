#include "common/learning/gaussian.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>
#include <numeric>
#include <vector>

#include <fmt/format.h>

#include "common/error.h"

namespace itn {
namespace {

// Standard deviations of exp(-4) to exp(4) of the prior's: no image tells or hides more.
constexpr double kMaxLogPrecision = 4;

// --- Points ---

constexpr int64_t kPoints = 2048;  // quantiles of 5 % are means of some hundred

// Standard normal points in n dimensions, row by row: those of Sobol's net, each in the middle of
// its cell, through the inverse of the normal distribution function; then with mean 0 and
// covariance 1 to the last bits, so that what is linear in them is exact.
std::vector<double> normal_points(int64_t n) {
  constexpr int64_t kBits = 30;  // of torch's direction numbers
  torch::Tensor directions = torch::zeros({n, kBits}, torch::kInt64);
  at::_sobol_engine_initialize_state_(directions, n);
  const torch::Tensor drawn = std::get<0>(at::_sobol_engine_draw(
      torch::zeros({n}, torch::kInt64), kPoints, directions, n, 0, torch::kFloat64));
  const torch::Tensor cells = (drawn * kPoints).floor();
  const torch::Tensor uniform = (cells + 0.5) / static_cast<double>(kPoints);
  torch::Tensor normal = std::numbers::sqrt2 * torch::erfinv(2 * uniform - 1);
  normal = normal - normal.mean(0);
  const torch::Tensor covariance = normal.t().matmul(normal) / static_cast<double>(kPoints);
  const torch::Tensor root = at::linalg_cholesky(covariance);
  normal = at::linalg_solve(root, normal.t()).t().contiguous();
  const double* values = normal.data_ptr<double>();
  return {values, values + kPoints * n};
}

// Made once.
std::span<const double> points_of(size_t n) {
  static std::mutex mutex;
  static std::map<size_t, std::vector<double>> known;
  const std::lock_guard lock(mutex);
  std::vector<double>& points = known[n];
  if (points.empty()) points = normal_points(static_cast<int64_t>(n));
  return points;
}

double log_precision(double output) {
  return kMaxLogPrecision * std::tanh(output / kMaxLogPrecision);
}

// The parts of the outputs.
struct Outputs {
  std::span<const double> mean, log_precision, regression;

  explicit Outputs(std::span<const double> all) {
    const size_t n = gaussian_coordinates(all.size());
    mean = all.first(n);
    log_precision = all.subspan(n, n);
    regression = all.subspan(2 * n);
  }
  size_t size() const { return mean.size(); }
  // a_ij, of j < i.
  double a(size_t i, size_t j) const { return regression[i * (i - 1) / 2 + j]; }
};

// The softmax of the last outputs of a mixture.
std::vector<double> weights_of(std::span<const double> logits) {
  const double most = std::ranges::max(logits);
  std::vector<double> weights;
  for (const double logit : logits) weights.push_back(std::exp(logit - most));
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  for (double& weight : weights) weight /= sum;
  return weights;
}

// Undoes z = D T d, line by line.
void to_coordinates(const Outputs& outputs, std::span<const double> z, std::span<double> result) {
  std::vector<double> d(outputs.size());
  for (size_t i = 0; i < d.size(); ++i) {
    d[i] = z[i] * std::exp(-log_precision(outputs.log_precision[i]));
    for (size_t j = 0; j < i; ++j) d[i] -= outputs.a(i, j) * d[j];
    result[i] = outputs.mean[i] + d[i];
  }
}

// Points of the distribution, row by row. Of a mixture, the number before those of a point says of
// which Gaussian it is.
std::vector<double> distribution_points(std::span<const double> outputs, size_t n) {
  const size_t count = mixture_components(outputs.size(), n);
  const size_t block = gaussian_outputs(n);
  std::vector<Outputs> gaussians;
  for (size_t k = 0; k < count; ++k) gaussians.emplace_back(outputs.subspan(k * block, block));
  std::vector<double> result(kPoints * n);
  if (count == 1) {
    const std::span<const double> points = points_of(n);
    for (size_t i = 0; i < points.size(); i += n) {
      to_coordinates(gaussians[0], points.subspan(i, n), std::span(result).subspan(i, n));
    }
    return result;
  }
  const std::vector<double> weights = weights_of(outputs.last(count));
  const std::span<const double> points = points_of(n + 1);
  for (size_t i = 0; i < kPoints; ++i) {
    const std::span<const double> point = points.subspan(i * (n + 1), n + 1);
    double below = 0.5 * std::erfc(-point[0] / std::numbers::sqrt2);
    size_t k = 0;
    while (k + 1 < count && below >= weights[k]) below -= weights[k++];
    to_coordinates(gaussians[k], point.subspan(1), std::span(result).subspan(i * n, n));
  }
  return result;
}

// --- What they say ---

// Values at the points, by number.
using Samples = std::array<std::vector<double>, kPosteriorNumbers>;

std::array<double, kPosteriorNumbers> numbers_of(const Material& m) {
  return {m.sigma_t,         m.albedo,           m.g, m.sigma_a(), m.sigma_s(), m.sigma_s_reduced(),
          diffuse_albedo(m), diffusion_length(m)};
}

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

ParameterPosterior describe(const std::vector<double>& samples, double level) {
  // Where quantiles lie between two of the samples.
  constexpr double kHighestLevel = 1 - 2.0 / static_cast<double>(kPoints);
  const double tail = (1 - std::min(level, kHighestLevel)) / 2;
  ParameterPosterior result;
  result.mean = mean_of(samples);
  result.standard_deviation = std::sqrt(covariance(samples, result.mean, samples, result.mean));
  result.median = quantile(samples, 0.5);
  result.low = quantile(samples, tail);
  result.high = quantile(samples, 1 - tail);
  return result;
}

// Three numbers of them.
JointPosterior describe(const Samples& samples, const IntervalLevels& levels, size_t first) {
  JointPosterior result;
  for (size_t i = 0; i < 3; ++i) {
    result.parameters[i] = describe(samples[first + i], levels[first + i]);
  }
  constexpr std::array<std::array<size_t, 2>, 3> kPairs{{{0, 1}, {0, 2}, {1, 2}}};
  for (size_t pair = 0; pair < 3; ++pair) {
    const auto [i, j] = kPairs[pair];
    const ParameterPosterior &a = result.parameters[i], &b = result.parameters[j];
    const double scale = a.standard_deviation * b.standard_deviation;
    result.correlations[pair] =
        scale > 0 ? covariance(samples[first + i], a.mean, samples[first + j], b.mean) / scale : 0;
  }
  return result;
}

// Of each channel.
std::vector<Samples> samples_of(const AnswerSpace& space, std::span<const double> all) {
  if (!std::ranges::all_of(all, [](double x) { return std::isfinite(x); })) {
    throw invalid_input("the network's prediction is not finite");
  }
  const size_t n = space.size();
  std::vector<Samples> channels(space.channels());
  const std::vector<double> points = distribution_points(all, n);
  for (size_t first = 0; first < points.size(); first += n) {
    const std::span<const double> at = std::span(points).subspan(first, n);
    for (size_t c = 0; c < channels.size(); ++c) {
      const auto numbers = numbers_of(space.channel(c).material(space.of_channel(c, at)));
      for (size_t k = 0; k < kPosteriorNumbers; ++k) channels[c][k].push_back(numbers[k]);
    }
  }
  return channels;
}

}  // namespace

size_t mixture_components(size_t outputs, size_t n) {
  const size_t each = gaussian_outputs(n) + 1;
  if (outputs == gaussian_outputs(n)) return 1;
  if (outputs % each != 0 || outputs < 2 * each) {
    throw invalid_input(
        fmt::format("{} numbers are no distribution over {} coordinates", outputs, n));
  }
  return outputs / each;
}

size_t gaussian_coordinates(size_t outputs) {
  for (size_t n = 1; gaussian_outputs(n) <= outputs; ++n) {
    if (gaussian_outputs(n) == outputs) return n;
  }
  throw invalid_input(fmt::format("{} numbers are no Gaussian", outputs));
}

namespace {

// Logarithms of precisions, batch x n.
torch::Tensor log_precisions(const torch::Tensor& outputs, int64_t n) {
  return kMaxLogPrecision * torch::tanh(outputs.slice(1, n, 2 * n) / kMaxLogPrecision);
}

// z of the header, batch x n.
torch::Tensor standard_scores(const torch::Tensor& outputs, const torch::Tensor& targets,
                              const torch::Tensor& l) {
  const int64_t n = targets.size(1);
  const torch::Tensor d = targets - outputs.slice(1, 0, n);
  const torch::Tensor a = outputs.slice(1, 2 * n);
  std::vector<torch::Tensor> rows;
  for (int64_t i = 0, regression = 0; i < n; ++i) {
    torch::Tensor sum = d.select(1, i);
    for (int64_t j = 0; j < i; ++j) sum = sum + a.select(1, regression++) * d.select(1, j);
    rows.push_back(sum);
  }
  return torch::stack(rows, 1) * l.exp();
}

}  // namespace

namespace {

// The outputs of the Gaussians of mixtures, one after the other: (batch K) x gaussian_outputs(n).
torch::Tensor gaussians_of(const torch::Tensor& outputs, int64_t n, int64_t count) {
  const auto each = static_cast<int64_t>(gaussian_outputs(static_cast<size_t>(n)));
  return outputs.slice(1, 0, count * each).reshape({-1, each});
}

int64_t components_of(const torch::Tensor& outputs, int64_t n) {
  return static_cast<int64_t>(
      mixture_components(static_cast<size_t>(outputs.size(1)), static_cast<size_t>(n)));
}

// Logarithms of the weights: batch x K.
torch::Tensor log_weights_of(const torch::Tensor& outputs, int64_t count) {
  return torch::log_softmax(outputs.slice(1, outputs.size(1) - count), 1);
}

torch::Tensor likelihood_of_gaussian(const torch::Tensor& outputs, const torch::Tensor& targets) {
  const int64_t n = targets.size(1);
  const torch::Tensor l = log_precisions(outputs, n);
  const torch::Tensor z = standard_scores(outputs, targets, l);
  const double normalisation = 0.5 * static_cast<double>(n) * std::log(2 * std::numbers::pi);
  return 0.5 * z.square().sum(1) - l.sum(1) + normalisation;
}

}  // namespace

torch::Tensor negative_log_likelihood(const torch::Tensor& outputs, const torch::Tensor& targets) {
  const int64_t n = targets.size(1), count = components_of(outputs, n);
  if (count == 1) return likelihood_of_gaussian(outputs, targets);
  const torch::Tensor each =
      likelihood_of_gaussian(gaussians_of(outputs, n, count), targets.repeat_interleave(count, 0))
          .reshape({-1, count});
  return -torch::logsumexp(log_weights_of(outputs, count) - each, 1);
}

torch::Tensor mean_of(const torch::Tensor& outputs, int64_t n) {
  const int64_t count = components_of(outputs, n);
  if (count == 1) return outputs.slice(1, 0, n);
  const torch::Tensor means =
      gaussians_of(outputs, n, count).slice(1, 0, n).reshape({-1, count, n});
  return (log_weights_of(outputs, count).exp().unsqueeze(2) * means).sum(1);
}

torch::Tensor region_probability(const torch::Tensor& outputs, const torch::Tensor& targets) {
  const int64_t n = targets.size(1);
  if (components_of(outputs, n) > 1) {
    const torch::Tensor likelihoods = negative_log_likelihood(outputs, targets);
    torch::Tensor result = torch::empty_like(likelihoods);
    for (int64_t i = 0; i < targets.size(0); ++i) {
      const torch::Tensor row = outputs[i].to(torch::kFloat64).contiguous();
      std::vector<double> points = distribution_points(
          {row.data_ptr<double>(), static_cast<size_t>(row.size(0))}, static_cast<size_t>(n));
      const torch::Tensor at =
          torch::from_blob(points.data(), {kPoints, n}, torch::TensorOptions(torch::kFloat64));
      const torch::Tensor likelier =
          negative_log_likelihood(row.unsqueeze(0).expand({kPoints, -1}), at) < likelihoods[i];
      result[i] = likelier.to(torch::kFloat64).mean();
    }
    return result;
  }
  // The sum of squares of n standard normal numbers has the distribution chi-squared.
  const torch::Tensor squares =
      standard_scores(outputs, targets, log_precisions(outputs, n)).square().sum(1);
  return at::special_gammainc(torch::full_like(squares, 0.5 * static_cast<double>(n)),
                              0.5 * squares);
}

torch::Tensor marginal_probability(const torch::Tensor& outputs, const torch::Tensor& targets) {
  const int64_t n = targets.size(1), count = components_of(outputs, n);
  const torch::Tensor gaussians = gaussians_of(outputs, n, count).to(torch::kFloat64).contiguous();
  const torch::Tensor weights = count == 1
                                    ? torch::ones({outputs.size(0), 1}, torch::kFloat64)
                                    : log_weights_of(outputs, count).exp().to(torch::kFloat64);
  torch::Tensor result = torch::zeros_like(targets);
  for (int64_t i = 0; i < targets.size(0); ++i) {
    for (int64_t k = 0; k < count; ++k) {
      const torch::Tensor row = gaussians[i * count + k];
      const Gaussian gaussian =
          to_gaussian({row.data_ptr<double>(), static_cast<size_t>(row.size(0))});
      const torch::Tensor deviation = at::linalg_inv(gaussian.precision).diagonal().sqrt();
      result[i].add_(at::special_ndtr((targets[i] - gaussian.mean) / deviation) * weights[i][k]);
    }
  }
  return result;
}

torch::Tensor calibrated(const torch::Tensor& outputs, const torch::Tensor& widths) {
  const int64_t n = widths.size(1), count = components_of(outputs, n);
  const torch::Tensor each = gaussians_of(outputs, n, count);
  const torch::Tensor precisions =
      each.slice(1, n, 2 * n) + widths[0] + widths[1] * each.slice(1, 0, 1);
  const torch::Tensor changed =
      torch::cat({each.slice(1, 0, n), precisions, each.slice(1, 2 * n)}, 1);
  if (count == 1) return changed;
  return torch::cat(
      {changed.reshape({outputs.size(0), -1}), outputs.slice(1, outputs.size(1) - count)}, 1);
}

torch::Tensor to_tensor(const v1::Calibration& widths, size_t n) {
  const auto count = static_cast<int>(n);
  torch::Tensor tensor = torch::empty({2, count}, torch::kFloat64);
  int64_t row = 0;
  for (const auto* numbers : {&widths.offset(), &widths.slope()}) {
    if (numbers->size() != count ||
        !std::ranges::all_of(*numbers, [](double x) { return std::isfinite(x); })) {
      throw invalid_input(
          fmt::format("the model's correction of widths needs {} finite numbers of a kind", n));
    }
    for (int k = 0; k < count; ++k) tensor[row][k] = numbers->Get(k);
    ++row;
  }
  return tensor;
}

// With T and D as in the header the precision is (D T)^T (D T).
Gaussian to_gaussian(std::span<const double> all) {
  const Outputs outputs(all);
  const auto n = static_cast<int64_t>(outputs.size());
  torch::Tensor t = torch::eye(n, torch::kFloat64), d = torch::empty({n}, torch::kFloat64);
  torch::Tensor mean = torch::empty({n}, torch::kFloat64);
  for (int64_t i = 0; i < n; ++i) {
    const auto row = static_cast<size_t>(i);
    mean[i] = outputs.mean[row];
    d[i] = std::exp(log_precision(outputs.log_precision[row]));
    for (int64_t j = 0; j < i; ++j) t[i][j] = outputs.a(row, static_cast<size_t>(j));
  }
  const torch::Tensor root = torch::diag(d).matmul(t);
  return {mean, root.t().matmul(root)};
}

// Covariances within and between the Gaussians.
Gaussian to_gaussian(std::span<const double> outputs, size_t n) {
  const size_t count = mixture_components(outputs.size(), n), each = gaussian_outputs(n);
  if (count == 1) return to_gaussian(outputs);
  const std::vector<double> weights = weights_of(outputs.last(count));
  const auto size = static_cast<int64_t>(n);
  torch::Tensor mean = torch::zeros({size}, torch::kFloat64);
  torch::Tensor squares = torch::zeros({size, size}, torch::kFloat64);
  for (size_t k = 0; k < count; ++k) {
    const Gaussian one = to_gaussian(outputs.subspan(k * each, each));
    mean += weights[k] * one.mean;
    squares += weights[k] * (at::linalg_inv(one.precision) + one.mean.outer(one.mean));
  }
  return {mean, at::linalg_inv(squares - mean.outer(mean))};
}

// Cholesky's factor begins with the first coordinate, D T with the last: so both are turned round.
std::vector<double> to_outputs(const Gaussian& gaussian) {
  constexpr double kNearlyMost = 0.9999 * kMaxLogPrecision;
  const torch::Tensor turned = at::linalg_cholesky(gaussian.precision.flip({0, 1}));
  const torch::Tensor root = turned.flip({0, 1}).t().contiguous();  // D T
  const auto r = root.accessor<double, 2>();
  const torch::Tensor mean = gaussian.mean.contiguous();
  const int64_t n = mean.size(0);
  std::vector<double> outputs(mean.data_ptr<double>(), mean.data_ptr<double>() + n);
  for (int64_t i = 0; i < n; ++i) {
    const double l = std::clamp(std::log(r[i][i]), -kNearlyMost, kNearlyMost);
    outputs.push_back(kMaxLogPrecision * std::atanh(l / kMaxLogPrecision));
  }
  for (int64_t i = 0; i < n; ++i) {
    for (int64_t j = 0; j < i; ++j) outputs.push_back(r[i][j] / r[i][i]);
  }
  return outputs;
}

Material Posterior::mean() const {
  const auto& p = material.parameters;
  return {p[0].mean, p[1].mean, p[2].mean};
}

std::vector<Posterior> posteriors(const AnswerSpace& space, std::span<const double> outputs,
                                  const IntervalLevels& levels) {
  std::vector<Posterior> result;
  for (const Samples& samples : samples_of(space, outputs)) {
    result.push_back({describe(samples, levels, 0), describe(samples, levels, 3),
                      describe(samples[6], levels[6]), describe(samples[7], levels[7])});
  }
  return result;
}

std::vector<IntervalLevels> levels_that_reach(const AnswerSpace& space,
                                              std::span<const double> outputs,
                                              std::span<const Material> truth) {
  std::vector<IntervalLevels> result;
  for (const Samples& samples : samples_of(space, outputs)) {
    const auto numbers = numbers_of(truth[result.size()]);
    IntervalLevels& levels = result.emplace_back();
    for (size_t k = 0; k < kPosteriorNumbers; ++k) {
      const auto below = std::ranges::count_if(
          samples[k], [limit = numbers[k]](double sample) { return sample < limit; });
      const double part = static_cast<double>(below) / static_cast<double>(samples[k].size());
      levels[k] = std::abs(2 * part - 1);
    }
  }
  return result;
}

IntervalLevels interval_levels(const v1::Calibration& calibration) {
  IntervalLevels levels = nominal_levels();
  const auto& given = calibration.interval_level();
  if (given.empty()) return levels;
  if (given.size() != static_cast<int>(levels.size()) ||
      !std::ranges::all_of(given, [](double x) { return x > 0 && x < 1; })) {
    throw invalid_input(
        fmt::format("the model's interval levels must be {} numbers in (0, 1)", levels.size()));
  }
  std::ranges::copy(given, levels.begin());
  return levels;
}

}  // namespace itn
