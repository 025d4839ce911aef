#include "client/bench/statistics.h"

#include <gtest/gtest.h>

#include <numeric>

namespace itn {
namespace {

TEST(Percentile, IsTheLeastThatAPartDoesNotExceed) {
  std::vector<double> hundred(100);
  std::iota(hundred.begin(), hundred.end(), 1);
  EXPECT_EQ(percentile(hundred, 0.5), 50);
  EXPECT_EQ(percentile(hundred, 0.9), 90);
  EXPECT_EQ(percentile(hundred, 0.99), 99);
  EXPECT_EQ(percentile(hundred, 1), 100);
  const std::vector<double> three = {1, 2, 3};
  EXPECT_EQ(percentile(three, 0.5), 2);
  EXPECT_EQ(percentile(three, 0.99), 3);
  EXPECT_EQ(percentile(three, 0.01), 1);
  EXPECT_EQ(percentile({}, 0.5), 0);
}

TEST(BenchFigures, CountOnlyWhatWasAnswered) {
  const BenchWindow window{.seconds = 2,
                           .latencies = {0.3, 0.1, 0.2},
                           .lateness = {0, 0, 0, 0.5, 0},
                           .refused = 1,
                           .failed = {{"INTERNAL", 1}}};
  const BenchFigures figures = figures_of(window);
  EXPECT_DOUBLE_EQ(figures.calls_per_second, 1.5);
  EXPECT_EQ(figures.p50, 0.2);
  EXPECT_EQ(figures.p99, 0.3);
  EXPECT_EQ(figures.late_p99, 0.5);
}

constexpr BenchFigures kSteady{.calls_per_second = 100, .p50 = 0.01, .p90 = 0.02, .p99 = 0.03};

TEST(Agreement, IsInThroughputAndInBothPercentiles) {
  EXPECT_TRUE(agree(std::vector(3, kSteady), 0));
  for (double BenchFigures::*figure :
       {&BenchFigures::calls_per_second, &BenchFigures::p50, &BenchFigures::p99}) {
    std::vector<BenchFigures> windows(3, kSteady);
    windows[1].*figure *=
        1.2;  // the mean is 1.0667 of the others: it is 12.5 % above, they 6 below
    EXPECT_TRUE(agree(windows, 0.126));
    EXPECT_FALSE(agree(windows, 0.124));
  }
  std::vector<BenchFigures> windows(3, kSteady);
  windows[1].p90 *= 2;
  EXPECT_TRUE(agree(windows, 0.1)) << "of p90, nothing is asked";
}

TEST(Agreement, IsNotWhereMoreAndMoreIsLeftUnfinished) {
  std::vector<BenchFigures> windows(3, kSteady);
  for (size_t i = 0; i < 3; ++i) windows[i].unfinished = 10 + i;
  EXPECT_FALSE(agree(windows, 0.1));
  windows[2].unfinished = 10;
  EXPECT_TRUE(agree(windows, 0.1)) << "it is more sometimes";
}

TEST(Agreement, IsNotWhereNothingIsAnswered) {
  EXPECT_FALSE(agree(std::vector<BenchFigures>(3), 0.1));
}

BenchWindow window_of(size_t calls, double latency) {
  BenchWindow window;
  window.seconds = 1;
  window.latencies.assign(calls, latency);
  window.lateness.assign(calls, 0);
  return window;
}

TEST(MeasureUntilStable, EndsWhenThreeInARowAgree) {
  size_t measured = 0;
  const std::vector<size_t> calls = {10, 100, 101, 50, 100, 101, 99, 7};
  const BenchResult result =
      measure_until_stable({}, [&] { return window_of(calls.at(measured++), 0.01); });
  EXPECT_TRUE(result.stable);
  EXPECT_EQ(result.windows, 7U);
  EXPECT_EQ(result.last.answered(), 300U) << "the last three together";
  EXPECT_DOUBLE_EQ(figures_of(result.last).calls_per_second, 100);
}

TEST(MeasureUntilStable, GivesUpAfterTheMost) {
  size_t measured = 0;
  const BenchResult result = measure_until_stable(
      {.tolerance = 0.1, .max_windows = 5}, [&] { return window_of(1U << measured++, 0.01); });
  EXPECT_FALSE(result.stable);
  EXPECT_EQ(result.windows, 5U);
  EXPECT_EQ(measured, 5U);
  EXPECT_EQ(result.last.answered(), 4U + 8U + 16U);
}

TEST(MeasureUntilStable, EndsWhereNothingIsAnswered) {
  size_t measured = 0;
  const BenchResult result = measure_until_stable({}, [&] {
    BenchWindow window = window_of(measured == 0 ? 5 : 0, 0.01);
    if (measured++ > 0) {
      window.failed["UNAVAILABLE"] = 4;
      window.lateness.assign(4, 0);
    }
    return window;
  });
  EXPECT_FALSE(result.stable);
  EXPECT_EQ(result.windows, 2U);
  EXPECT_EQ(result.last.answered(), 5U);
  EXPECT_EQ(result.last.failed.at("UNAVAILABLE"), 4U);
}

}  // namespace
}  // namespace itn
