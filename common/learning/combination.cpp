#include "common/learning/combination.h"

#include <fmt/format.h>

#include <cmath>

#include "common/error.h"
#include "common/low_discrepancy.h"

namespace itn {
namespace {

Gaussian stored_prior(const v1::Model& model) {
  constexpr double kRounding = 1e-6;
  const int n = model.mean_size();
  if (model.correlation_size() != n * n) {
    throw invalid_input(fmt::format(
        "the model does not say how its training materials were spread, so that answers for "
        "several images cannot be combined: model.correlation has {} numbers; {} coordinates "
        "have {}",
        model.correlation_size(), n, n * n));
  }
  const torch::Tensor correlation =
      torch::tensor(c10::ArrayRef<double>(model.correlation().data(), static_cast<size_t>(n * n)),
                    torch::kFloat64)
          .view({n, n});
  const bool is_one = correlation.isfinite().all().item<bool>() &&
                      correlation.equal(correlation.t()) &&
                      std::get<0>(at::linalg_eigh(correlation)).min().item<double>() > -kRounding;
  if (!is_one) {
    throw invalid_input("model.correlation is not that of a distribution over all coordinates");
  }
  // Where all media were gray, their colours have nothing that differs.
  constexpr double kLeast = 1e-4;
  const torch::Tensor covariance = correlation + kLeast * torch::eye(n, torch::kFloat64);
  return {torch::zeros({n}, torch::kFloat64), at::linalg_inv(covariance)};
}

// Of a model that says nothing but its bounds: sigma_t log-uniformly, albedo and g uniformly.
Gaussian prior_of_bounds(const v1::Model& model) {
  constexpr uint32_t kPoints = 4096;
  const OutputSpace space(model);
  const Box range = to_box(training_range(model.bounds()));
  for (size_t k = 0; k < 3; ++k) {
    if (!(range.max[k] > range.min[k]) || !(range.min[0] > 0)) {
      throw invalid_input(
          "the model's bounds do not say of what range its training materials were, so that "
          "answers for several images cannot be combined");
    }
  }
  torch::Tensor points = torch::empty({kPoints, 3}, torch::kFloat64);
  auto rows = points.accessor<double, 2>();
  for (uint32_t i = 0; i < kPoints; ++i) {
    const auto cell = sobol_point(i);
    const auto between = [&](size_t k, double min, double max) {
      return min + (max - min) * (cell[k] + 0.5) * 0x1p-32;
    };
    const Material material{std::exp(between(0, std::log(range.min[0]), std::log(range.max[0]))),
                            between(1, range.min[1], range.max[1]),
                            between(2, range.min[2], range.max[2])};
    const MaterialCoordinates z = space.standardized(material);
    for (int64_t k = 0; k < 3; ++k) rows[i][k] = z[static_cast<size_t>(k)];
  }
  const torch::Tensor mean = points.mean(0);
  const torch::Tensor d = points - mean;
  return {mean, at::linalg_inv(d.t().matmul(d) / static_cast<double>(kPoints))};
}

// A precision that the prior has 1 of, and the answer there.
struct Direction {
  double precision, mean;
};

// What `count` answers say together in a direction, in which their mean is `answer`, with the prior
// taken out of all but one: out of the mean answer one with its middle at `prior`.
Direction combined(const Direction& answer, double prior, double count) {
  constexpr double kDeviations = 2;
  if (answer.precision <= 1) return answer;
  Direction all;
  all.precision = 1 + count * (answer.precision - 1);
  // From a prior that is a Gaussian come answers whose means vary by 1 - 1 / precision. Where they
  // are much farther away, the prior was wider than that, and is not taken out.
  const double farthest =
      std::max(kDeviations * std::sqrt(1 - 1 / all.precision), std::abs(answer.mean));
  const double mean = count * (answer.precision * answer.mean - prior) / all.precision;
  all.mean = std::clamp(mean, -farthest, farthest);
  return all;
}

}  // namespace

Combination::Combination(const v1::Model& model) : error_correlation_(model.error_correlation()) {
  if (model.output() != v1::GAUSSIAN) {
    throw invalid_input(
        "the model answers no distributions, so that answers for several images cannot be "
        "combined; one of --preset residual does");
  }
  if (!(error_correlation_ >= 0 && error_correlation_ <= 1)) {
    throw invalid_input(
        fmt::format("model.error_correlation is {}; it must be in [0, 1]", error_correlation_));
  }
  const size_t channels = AnswerSpace(model).channels();
  for (size_t c = 0; c < channels; ++c) {
    log_size_units_.push_back(model.standard_deviation(static_cast<int>(c)));
  }
  const bool says_bounds_alone = model.correlation().empty() && channels == 1;
  prior_ = says_bounds_alone ? prior_of_bounds(model) : stored_prior(model);
}

std::vector<double> Combination::operator()(std::span<const ImageAnswer> answers) const {
  if (answers.size() == 1) return answers.front().outputs;
  const double weight = 1 / (1 + static_cast<double>(answers.size() - 1) * error_correlation_);
  const auto count = static_cast<double>(answers.size());
  // The means over the images of their answers' precision, of what these say of the distance from
  // the prior's mean, and of where the prior of an object of that size has its own, from there.
  torch::Tensor precision = torch::zeros_like(prior_.precision);
  torch::Tensor information = torch::zeros_like(prior_.mean);
  torch::Tensor middle = torch::zeros_like(prior_.mean);
  for (const ImageAnswer& answer : answers) {
    // What is 1 / mm for one object is another number per longest side of another.
    torch::Tensor shift = torch::zeros_like(prior_.mean);
    const double larger = std::log(answers.front().object_size / answer.object_size);
    for (size_t c = 0; c < log_size_units_.size(); ++c) {
      shift[static_cast<int64_t>(c)] = larger / log_size_units_[c];
    }
    const Gaussian image = to_gaussian(answer.outputs, static_cast<size_t>(prior_.mean.size(0)));
    precision = precision + image.precision / count;
    information = information + image.precision.matmul(image.mean + shift - prior_.mean) / count;
    middle = middle + shift / count;
  }
  // Directions in which the prior has a precision of 1, and the mean answer no correlations.
  const torch::Tensor root = at::linalg_cholesky(prior_.precision);
  const torch::Tensor inverse = at::linalg_inv(root);
  const auto [values, vectors] = at::linalg_eigh(inverse.matmul(precision).matmul(inverse.t()));
  const torch::Tensor answer = vectors.t().matmul(inverse.matmul(information)) / values;
  const torch::Tensor prior = vectors.t().matmul(root.t().matmul(middle));
  torch::Tensor precisions = torch::empty_like(values), means = torch::empty_like(values);
  for (int64_t k = 0; k < values.size(0); ++k) {
    const Direction all = combined({values[k].item<double>(), answer[k].item<double>()},
                                   prior[k].item<double>(), count * weight);
    precisions[k] = all.precision;
    means[k] = all.mean;
  }
  const torch::Tensor back = root.matmul(vectors);
  return to_outputs({prior_.mean + inverse.t().matmul(vectors.matmul(means)),
                     back.matmul(torch::diag(precisions)).matmul(back.t())});
}

}  // namespace itn
