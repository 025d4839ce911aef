#include "client/bench/arrivals.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/statistics.h"

namespace itn {
namespace {

TEST(Arrivals, OfConstantGapsDoNotDrift) {
  Arrivals arrivals(3, ArrivalDistribution::kConstant, 0);
  for (int i = 0; i < 1'000'000; ++i) {
    const double time = arrivals.next();
    ASSERT_NEAR(time, i / 3.0, 1e-9);
  }
}

// The counts of equal times are Poisson's: their mean and their variance are rate x time.
TEST(Arrivals, OfAPoissonProcessAreIndependent) {
  constexpr double kRate = 50, kTime = 0.4;
  Arrivals arrivals(kRate, ArrivalDistribution::kPoisson, 7);
  std::vector<double> counts(20'000);
  for (double time = arrivals.next(); time < kTime * static_cast<double>(counts.size());) {
    ++counts[static_cast<size_t>(time / kTime)];
    const double next = arrivals.next();
    ASSERT_GE(next, time);
    time = next;
  }
  std::vector<double> squares, products;
  for (size_t i = 0; i < counts.size(); ++i) {
    squares.push_back((counts[i] - kRate * kTime) * (counts[i] - kRate * kTime));
    if (i > 0) {
      products.push_back((counts[i] - kRate * kTime) * (counts[i - 1] - kRate * kTime));
    }
  }
  const testing::Estimated expected{.mean = kRate * kTime};
  testing::expect_equal(testing::over_batches(counts), expected, 3, "mean of the counts");
  testing::expect_equal(testing::over_batches(squares), expected, 3, "their variance");
  testing::expect_equal(testing::over_batches(products), {}, 3, "covariance of neighbours");
}

TEST(Arrivals, FollowFromTheSeed) {
  Arrivals one(10, ArrivalDistribution::kPoisson, 1), same(10, ArrivalDistribution::kPoisson, 1);
  Arrivals other(10, ArrivalDistribution::kPoisson, 2);
  const double first = one.next();
  EXPECT_EQ(first, same.next());
  EXPECT_NE(first, other.next());
}

}  // namespace
}  // namespace itn
