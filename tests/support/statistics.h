// Statistical comparison of Monte Carlo results.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

namespace itn::testing {

// A Monte Carlo result with the standard error of its mean.
struct Estimated {
  double mean = 0;
  double standard_error = 0;
  // The degrees of freedom of the standard error, which is itself an estimate. A value that is
  // known exactly has none.
  double degrees_of_freedom = std::numeric_limits<double>::infinity();
};

// Mean and standard error over independent batches.
inline Estimated over_batches(const std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  double sum = 0, squares = 0;
  for (const double v : values) sum += v;
  const double mean = sum / n;
  for (const double v : values) squares += (v - mean) * (v - mean);
  return {mean, std::sqrt(squares / (n - 1) / n), n - 1};
}

// The slope of the line that fits values at equal distances best (least squares), per distance.
// Where neighbours differ from the line alike, there are fewer of them than it seems: n values
// whose residuals have the lag-one correlation r count as n (1 - r) / (1 + r) (Bartlett, "Some
// aspects of the time-correlation problem in regard to tests of significance", 1935).
inline Estimated fitted_slope(const std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  const double middle = (n - 1) / 2;
  double mean = 0;
  for (const double v : values) mean += v / n;
  double xx = 0, xy = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    const double x = static_cast<double>(i) - middle;
    xx += x * x;
    xy += x * (values[i] - mean);
  }
  std::vector<double> residuals;
  for (size_t i = 0; i < values.size(); ++i) {
    residuals.push_back(values[i] - mean - xy / xx * (static_cast<double>(i) - middle));
  }
  double squares = 0, products = 0;
  for (size_t i = 0; i < residuals.size(); ++i) {
    squares += residuals[i] * residuals[i];
    if (i > 0) products += residuals[i] * residuals[i - 1];
  }
  const double r = squares > 0 ? std::clamp(products / squares, 0.0, 0.99) : 0;
  const double independent = n * (1 - r) / (1 + r);
  return {xy / xx, std::sqrt(squares / (n - 2) / xx * n / independent),
          std::max(1.0, independent - 2)};
}

// a - b. The degrees of freedom are those of Welch, "The generalization of 'Student's' problem when
// several different population variances are involved", 1947.
inline Estimated difference(const Estimated& a, const Estimated& b) {
  const double variance_a = a.standard_error * a.standard_error;
  const double variance_b = b.standard_error * b.standard_error;
  const double variance = variance_a + variance_b;
  return {a.mean - b.mean, std::sqrt(variance),
          variance * variance /
              (variance_a * variance_a / a.degrees_of_freedom +
               variance_b * variance_b / b.degrees_of_freedom)};
}

// The probability that |t| of Student's distribution exceeds this, by its closed form for whole
// degrees of freedom n (Abramowitz and Stegun, "Handbook of Mathematical Functions", 26.7.3 and
// 26.7.4), which is a finite sum of powers of the cosine of theta = arctan(t / sqrt n). Others are
// rounded down, which errs on the side of larger tails; from 10^5 on it is the normal distribution.
inline double two_sided_tail(double t, double degrees_of_freedom) {
  if (!(degrees_of_freedom < 1e5)) return std::erfc(t / std::numbers::sqrt2);
  const int n = static_cast<int>(degrees_of_freedom);
  const double theta = std::atan(t / std::sqrt(n));
  const double cosine = std::cos(theta), sine = std::sin(theta);
  // Even n: 1 + (1/2) cos^2 + (1 3)/(2 4) cos^4 + ... ; odd: cos + (2/3) cos^3 + ...
  double term = n % 2 == 0 ? 1 : cosine;
  double sum = 0;
  for (int power = n % 2; power <= n - 2; power += 2) {
    sum += term;
    term *= cosine * cosine * (power + 1) / (power + 2);
  }
  const double inside = n % 2 == 0 ? sine * sum : 2 / std::numbers::pi * (theta + sine * sum);
  return 1 - inside;
}

// |t| that one of `comparisons` independent true hypotheses exceeds with probability 1e-3 (Sidak).
inline double t_threshold(int comparisons, double degrees_of_freedom) {
  const double each = -std::expm1(std::log1p(-1e-3) / comparisons);
  double low = 0, high = 1;  // by bisection
  while (two_sided_tail(high, degrees_of_freedom) > each) high *= 2;
  while (high - low > 1e-6 * high) {
    const double middle = (low + high) / 2;
    (two_sided_tail(middle, degrees_of_freedom) > each ? low : high) = middle;
  }
  return high;
}

// Expects a == b within the noise of both, as one of `comparisons` in the test.
inline void expect_equal(const Estimated& a, const Estimated& b, int comparisons,
                         const std::string& what) {
  const Estimated off = difference(a, b);
  const double t = off.mean / off.standard_error;
  EXPECT_LT(std::abs(t), t_threshold(comparisons, off.degrees_of_freedom))
      << what << ": " << a.mean << " +- " << a.standard_error << " against " << b.mean << " +- "
      << b.standard_error;
  ::testing::Test::RecordProperty(what + " t", std::to_string(t));
  std::printf("  %-46s %.6g +- %.2g against %.6g +- %.2g, t = %+.2f\n", what.c_str(), a.mean,
              a.standard_error, b.mean, b.standard_error, t);
}

// Expects that the comparison would have shown a relative error of this size: 4 standard errors.
inline void expect_resolution(const Estimated& a, double truth, double relative,
                              const std::string& what) {
  EXPECT_LT(4 * a.standard_error, relative * std::abs(truth))
      << what << " is too noisy to show an error of " << 100 * relative << " %: it shows "
      << 100 * 4 * a.standard_error / std::abs(truth) << " %";
  std::printf("  %-46s shows %.2g %% of %.2g %%\n", what.c_str(),
              100 * 4 * a.standard_error / std::abs(truth), 100 * relative);
}

}  // namespace itn::testing
