// Statistical comparison of Monte Carlo results.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace itn::testing {

// A Monte Carlo result with the standard error of its mean.
struct Estimated {
  double mean = 0;
  double standard_error = 0;
};

// Mean and standard error over independent batches.
inline Estimated over_batches(const std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  double sum = 0, squares = 0;
  for (const double v : values) {
    sum += v;
  }
  const double mean = sum / n;
  for (const double v : values) {
    squares += (v - mean) * (v - mean);
  }
  return {mean, std::sqrt(squares / (n - 1) / n)};
}

// |z| that one of `comparisons` independent true hypotheses exceeds with probability 1e-3 (Sidak).
inline double z_threshold(int comparisons) {
  const double each = -std::expm1(std::log1p(-1e-3) / comparisons);
  double low = 0, high = 40;  // two-sided: solves erfc(z / sqrt 2) = each by bisection
  while (high - low > 1e-6) {
    const double middle = (low + high) / 2;
    (std::erfc(middle / std::sqrt(2.0)) > each ? low : high) = middle;
  }
  return high;
}

// Expects a == b within the noise of both, as one of `comparisons` in the test.
inline void expect_equal(Estimated a, Estimated b, int comparisons, const std::string& what) {
  const double sigma = std::hypot(a.standard_error, b.standard_error);
  const double z = (a.mean - b.mean) / sigma;
  EXPECT_LT(std::abs(z), z_threshold(comparisons))
      << what << ": " << a.mean << " +- " << a.standard_error << " against " << b.mean << " +- "
      << b.standard_error;
  ::testing::Test::RecordProperty(what + " z", std::to_string(z));
  std::printf("  %-46s %.6g +- %.2g against %.6g +- %.2g, z = %+.2f\n", what.c_str(), a.mean,
              a.standard_error, b.mean, b.standard_error, z);
}

// Expects that the comparison would have shown a relative error of this size: 4 standard errors.
inline void expect_resolution(Estimated a, double truth, double relative, const std::string& what) {
  EXPECT_LT(4 * a.standard_error, relative * std::abs(truth))
      << what << " is too noisy to show an error of " << 100 * relative << " %";
}

}  // namespace itn::testing
