// The statistics that the tests of the tracer stand on.
#include "tests/support/statistics.h"

#include <random>

namespace itn::testing {
namespace {

// Quantiles from the usual tables of Student's distribution, rounded there to three decimals.
TEST(StudentTest, TailsAreThoseOfTheTables) {
  struct Row {
    double degrees_of_freedom, t, two_sided;
  };
  for (const Row& row :
       {Row{1, 12.706, 0.05}, Row{2, 4.303, 0.05}, Row{3, 5.841, 0.01}, Row{4, 8.610, 0.001},
        Row{5, 2.571, 0.05}, Row{10, 4.587, 0.001}, Row{30, 3.646, 0.001}, Row{60, 3.460, 0.001},
        Row{120, 3.373, 0.001}, Row{1000, 3.300, 0.001}}) {
    // Half a unit of the last place of t, by the slope of the tail there.
    const double rounding = std::abs(two_sided_tail(row.t - 5e-4, row.degrees_of_freedom) -
                                     two_sided_tail(row.t + 5e-4, row.degrees_of_freedom)) /
                            2;
    EXPECT_NEAR(two_sided_tail(row.t, row.degrees_of_freedom), row.two_sided, 1.05 * rounding)
        << row.degrees_of_freedom;
  }
}

TEST(StudentTest, BecomesNormal) {
  const double infinite = std::numeric_limits<double>::infinity();
  EXPECT_NEAR(two_sided_tail(3.2905, infinite), 1e-3, 1e-7);
  for (const double t : {0.5, 2.0, 5.0}) {
    EXPECT_NEAR(two_sided_tail(t, 99999), two_sided_tail(t, infinite), 1e-5);
  }
}

TEST(StudentTest, ThresholdIsTheQuantile) {
  for (const int comparisons : {1, 24, 120}) {
    for (const double n : {31.0, 63.0, 4000.0}) {
      const double each = two_sided_tail(t_threshold(comparisons, n), n);
      EXPECT_NEAR(std::pow(1 - each, comparisons), 1 - 1e-3, 1e-8);
    }
  }
  // Few batches ask for more: what the normal distribution would let through.
  EXPECT_NEAR(t_threshold(1, 31), 3.633, 1e-3);
  EXPECT_GT(t_threshold(120, 31), t_threshold(120, 63) + 0.1);
}

TEST(StudentTest, WelchsDegreesOfFreedom) {
  const Estimated a{3, 0.2, 31}, known{1, 0}, b{2, 0.2, 31};
  EXPECT_DOUBLE_EQ(difference(a, known).degrees_of_freedom, 31);
  EXPECT_DOUBLE_EQ(difference(a, known).standard_error, 0.2);
  EXPECT_DOUBLE_EQ(difference(a, b).degrees_of_freedom, 62);
  EXPECT_DOUBLE_EQ(difference(a, b).mean, 1);
}

TEST(Slope, OfALineIsExact) {
  const Estimated line = fitted_slope({1, 3, 5, 7, 9});
  EXPECT_DOUBLE_EQ(line.mean, 2);
  EXPECT_NEAR(line.standard_error, 0, 1e-12);
}

// Noise about lines: the error is what the slopes scatter by, also where noise has a memory.
TEST(Slope, KnowsItsError) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (const double memory : {0.0, 0.7}) {
    std::vector<double> errors;  // in standard errors
    for (int repetition = 0; repetition < 400; ++repetition) {
      std::vector<double> values;
      double noise = 0;
      for (int i = 0; i < 200; ++i) {
        noise = memory * noise + normal(random);
        values.push_back(0.5 * i + noise);
      }
      const Estimated found = fitted_slope(values);
      errors.push_back((found.mean - 0.5) / found.standard_error);
    }
    const Estimated bias = over_batches(errors);
    expect_equal(bias, {0, 0}, 2, "bias of slopes, in their errors");
    const double scatter = bias.standard_error * std::sqrt(static_cast<double>(errors.size()));
    // A scatter is known to 1 / sqrt(2 * 399) of itself; that of the memory is estimated, too.
    EXPECT_NEAR(scatter, 1, 0.15) << memory;
  }
}

}  // namespace
}  // namespace itn::testing
