// The Henyey-Greenstein phase function (Henyey, Greenstein, "Diffuse radiation in the galaxy",
// 1941). cos_theta is the cosine between the directions of propagation before and after the
// scattering, so that g > 0 scatters forward. Densities are per steradian.
#pragma once

#include <cmath>
#include <numbers>

namespace itn::tracer {

// p(cos_theta) = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos_theta)^(3/2)).
inline float hg_phase(float cos_theta, float g) {
  const float q = 1 + g * g - 2 * g * cos_theta;
  return (1 - g * g) * (0.25F * std::numbers::inv_pi_v<float>) / (q * std::sqrt(q));
}

// d log p / dg. Taking the logarithm of p and differentiating term by term:
//   -2 g / (1 - g^2) - 3 (g - cos_theta) / (1 + g^2 - 2 g cos_theta).
inline float hg_score(float cos_theta, float g) {
  return -2 * g / (1 - g * g) - 3 * (g - cos_theta) / (1 + g * g - 2 * g * cos_theta);
}

// Draws cos_theta with density 2 pi p. The distribution function inverts to
//   cos_theta = [1 + g^2 - ((1 - g^2) / (1 + g x))^2] / (2 g),  x = 2 u - 1 in [-1, 1).
// Bringing both terms over (1 + g x)^2 makes the numerator divisible by 2 g; what is left has no
// cancellation at g = 0, where it is cos_theta = x:
//   cos_theta = [x + g (x^2 + 3) / 2 + g^2 x + g^3 (x^2 - 1) / 2] / (1 + g x)^2.
inline float sample_hg(float u, float g) {
  const float x = 2 * u - 1;
  const float denominator = 1 + g * x;
  const float numerator = x + g * (0.5F * (x * x + 3) + g * (x + g * 0.5F * (x * x - 1)));
  return std::fmin(1.0F, std::fmax(-1.0F, numerator / (denominator * denominator)));
}

}  // namespace itn::tracer
