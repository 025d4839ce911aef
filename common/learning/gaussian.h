// A network's answer as a distribution: a Gaussian over standardised UNBOUNDED coordinates, what
// the truth costs under it, and what it says about the material.
//
// The nine outputs are the mean m (3), logarithms of precisions l (3) and regressions a10, a20,
// a21. With d = coordinates - m,
//   z_0 = exp(l_0)  d_0
//   z_1 = exp(l_1) (d_1 + a10 d_0)
//   z_2 = exp(l_2) (d_2 + a20 d_0 + a21 d_1)
// are independent and standard normal: z = D T d, the modified Cholesky factor of the precision
// (Pourahmadi, "Joint mean-covariance models with applications to longitudinal data", Biometrika
// 1999), for which any nine numbers will do. Outputs that are all 0 are the standard normal.
#pragma once

#include <array>
#include <span>

#include <torch/types.h>

#include "common/learning/parameterization.h"
#include "common/material.h"
#include "itn/v1/learning.pb.h"

namespace itn {

inline constexpr int64_t kGaussianOutputs = 9;

// Minus the logarithm of the density at the targets (batch x 3) for outputs (batch x 9): batch.
// Log-precisions end softly at -4 and 4, so that neither a certain network nor one that has given
// up makes it infinite.
torch::Tensor negative_log_likelihood(const torch::Tensor& outputs, const torch::Tensor& targets);

// The outputs with other widths, log-precision l_k + offset_k + slope_k m_0. `widths`: 2 x 3,
// offsets and slopes, in which the result can be differentiated.
torch::Tensor calibrated(const torch::Tensor& outputs, const torch::Tensor& widths);

// Offsets and slopes, 2 x 3, double. Throws Error (invalid input) unless there are three finite
// numbers of each.
torch::Tensor to_tensor(const v1::Calibration& widths);

// The same Gaussian by its mean and its precision, the inverse of its covariance.
struct Gaussian {
  torch::Tensor mean;       // 3, double
  torch::Tensor precision;  // 3 x 3, double, symmetric and positive definite
};
Gaussian to_gaussian(std::span<const double, kGaussianOutputs> outputs);

// The outputs that stand for it; standard deviations end softly, as above.
std::array<double, kGaussianOutputs> to_outputs(const Gaussian& gaussian);

struct ParameterPosterior {
  double mean = 0, standard_deviation = 0;
  double low = 0, high = 0;  // 5 % and 95 % quantiles
};

// Three parameters at a time, and the correlations of the first with the second, the first with the
// third, and the second with the third (0 where one of them is certain).
struct JointPosterior {
  std::array<ParameterPosterior, 3> parameters;
  std::array<double, 3> correlations{};
};

struct Posterior {
  JointPosterior material;    // sigma_t, albedo, g
  JointPosterior scattering;  // sigma_a, sigma_s, sigma_s_reduced

  // The single answer with the smallest expected squared error in each parameter.
  Material mean() const;
};

// The posterior of the Gaussian with these outputs, by quasi-random points that are always the
// same. Points outside of the space's bounds count as the nearest inside. Throws Error (invalid
// input) if an output is not finite.
Posterior posterior(const OutputSpace& space, std::span<const double, kGaussianOutputs> outputs);

}  // namespace itn
