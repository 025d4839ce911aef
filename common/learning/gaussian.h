// A network's answer as a distribution: a Gaussian over n standardised UNBOUNDED coordinates, or a
// mixture of K of them, what the truth costs under it, and what it says about the material.
//
// The outputs of a Gaussian are the mean m (n), logarithms of precisions l (n) and regressions
// a_ij, j < i, row by row (n (n - 1) / 2). With d = coordinates - m,
//   z_i = exp(l_i) (d_i + sum_j a_ij d_j)
// are independent and standard normal: z = D T d, the modified Cholesky factor of the precision
// (Pourahmadi, "Joint mean-covariance models with applications to longitudinal data", Biometrika
// 1999), for which any numbers will do. Outputs that are all 0 are the standard normal.
//
// The outputs of a mixture are those of its Gaussians, one after the other, and then K numbers,
// whose softmax are the weights (Bishop, "Mixture density networks", 1994).
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include <torch/types.h>

#include "common/learning/parameterization.h"
#include "common/material.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// Outputs over n coordinates: 9 over 3, 35 over 7.
constexpr size_t gaussian_outputs(size_t n) {
  return 2 * n + n * (n - 1) / 2;
}

// Outputs over n coordinates of so many Gaussians: of 8 over 7 coordinates 288.
constexpr size_t mixture_outputs(size_t n, size_t components) {
  return components > 1 ? components * (gaussian_outputs(n) + 1) : gaussian_outputs(n);
}

// Of how many Gaussians over n coordinates so many outputs are. Throws Error (invalid input) if
// they are of no number of them.
size_t mixture_components(size_t outputs, size_t n);

// Coordinates of so many outputs of one Gaussian. Throws Error (invalid input) if no number has
// them.
size_t gaussian_coordinates(size_t outputs);

// Minus the logarithm of the density at the targets (batch x n) for outputs (batch x
// mixture_outputs(n, K)): batch. Log-precisions end softly at -4 and 4, so that neither a certain
// network nor one that has given up makes it infinite.
torch::Tensor negative_log_likelihood(const torch::Tensor& outputs, const torch::Tensor& targets);

// The mean: batch x n.
torch::Tensor mean_of(const torch::Tensor& outputs, int64_t n);

// The probability of the region where the density is higher than at the target: batch x n -> batch.
// Of a Gaussian it is an ellipsoid around its mean; of a mixture, 2048 quasi-random points tell. It
// is uniform in [0, 1] where targets come from their distributions.
torch::Tensor region_probability(const torch::Tensor& outputs, const torch::Tensor& targets);

// The probability of a value below the target, of each coordinate by itself: batch x n -> batch x
// n. As uniform as above.
torch::Tensor marginal_probability(const torch::Tensor& outputs, const torch::Tensor& targets);

// The outputs with other widths, log-precision l_k + offset_k + slope_k m_0, of each Gaussian.
// `widths`: 2 x n,
// offsets and slopes, in which the result can be differentiated.
torch::Tensor calibrated(const torch::Tensor& outputs, const torch::Tensor& widths);

// Offsets and slopes, 2 x n, double. Throws Error (invalid input) unless there are n finite numbers
// of each.
torch::Tensor to_tensor(const v1::Calibration& widths, size_t n);

// The same Gaussian by its mean and its precision, the inverse of its covariance.
struct Gaussian {
  torch::Tensor mean;       // n, double
  torch::Tensor precision;  // n x n, double, symmetric and positive definite
};
Gaussian to_gaussian(std::span<const double> outputs);
// Of a mixture over n coordinates, the Gaussian that has its mean and its covariance.
Gaussian to_gaussian(std::span<const double> outputs, size_t n);

// The outputs that stand for it; standard deviations end softly, as above.
std::vector<double> to_outputs(const Gaussian& gaussian);

struct ParameterPosterior {
  double mean = 0, standard_deviation = 0;
  double median = 0;
  double low = 0, high = 0;  // of the 90 % interval, at quantiles that IntervalLevels says
};

// What a posterior says of a channel, number by number: sigma_t, albedo, g, sigma_a, sigma_s,
// sigma_s_reduced, diffuse albedo and diffusion length.
inline constexpr size_t kPosteriorNumbers = 8;

// The probability that a distribution gives to what is called the 90 % interval of each number.
// Where distributions are not quite right, it is another than 0.9 that holds nine of ten truths.
using IntervalLevels = std::array<double, kPosteriorNumbers>;
constexpr IntervalLevels nominal_levels() {
  IntervalLevels levels{};
  levels.fill(0.9);
  return levels;
}

// Three parameters at a time, and the correlations of the first with the second, the first with the
// third, and the second with the third (0 where one of them is certain).
struct JointPosterior {
  std::array<ParameterPosterior, 3> parameters;
  std::array<double, 3> correlations{};
};

struct Posterior {
  JointPosterior material;    // sigma_t, albedo, g
  JointPosterior scattering;  // sigma_a, sigma_s, sigma_s_reduced
  // What the eye sees of it: diffuse_albedo(), and diffusion_length() in mm.
  ParameterPosterior diffuse_albedo, diffusion_length;

  // The single answer with the smallest expected squared error in each parameter.
  Material mean() const;
};

// The posterior of each channel by the distribution with these outputs, from quasi-random points
// that are always the same. Points outside of the space's bounds count as the nearest inside.
// Throws Error (invalid input) if an output is not finite, or there are not as many as the space
// needs.
std::vector<Posterior> posteriors(const AnswerSpace& space, std::span<const double> outputs,
                                  const IntervalLevels& levels = nominal_levels());

// The level whose intervals just reach the truth, of each number of each channel, from the same
// points. Throws as posteriors().
std::vector<IntervalLevels> levels_that_reach(const AnswerSpace& space,
                                              std::span<const double> outputs,
                                              std::span<const Material> truth);

// The model's levels. Throws Error (invalid input) unless there are none, or as many as there are
// numbers, in (0, 1).
IntervalLevels interval_levels(const v1::Calibration& calibration);

}  // namespace itn
