#include "common/rpc/call_statistics.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "common/rpc/call_log.h"

namespace itn {
namespace {

using namespace std::chrono_literals;

const CallStatistics::Clock::time_point kStart{};

CallRecord worked(double queue, double work, double units = 1) {
  return {.method = "RenderGrad",
          .status = grpc::StatusCode::OK,
          .times = CallRecord::Times{.queue = queue, .work = work},
          .units = units,
          .unit = "paths"};
}

v1::MethodStatus only_method(const CallStatistics& statistics,
                             CallStatistics::Clock::time_point now) {
  v1::ServerStatus status;
  statistics.describe(status, now);
  EXPECT_EQ(status.methods_size(), 1);
  return status.methods(0);
}

TEST(LatencyCounts, QuantilesAreKnownToWithinTenPerCent) {
  LatencyCounts counts;
  for (int i = 1; i <= 10'000; ++i) counts.add(i * 1e-3);  // 1 ms to 10 s
  for (const double p : {0.01, 0.5, 0.9, 0.99, 1.0}) {
    EXPECT_NEAR(counts.quantile(p), 10 * p, 0.1 * 10 * p) << p;
  }
}

TEST(LatencyCounts, TimesBeyondEitherEndCount) {
  LatencyCounts counts;
  for (const double seconds : {0.0, 1e-9, 1e-4, 1e9}) counts.add(seconds);
  const v1::LatencyHistogram histogram = counts.histogram();
  ASSERT_EQ(histogram.counts_size(), 26);
  EXPECT_EQ(histogram.counts(0), 3U);
  EXPECT_EQ(histogram.counts(25), 1U);
  EXPECT_EQ(counts.count(), 4U);
  EXPECT_EQ(LatencyCounts().quantile(0.5), 0);
}

// A place of the histogram is an octave: 0.1 ms to 0.2 ms, and so on.
TEST(LatencyCounts, HistogramIsByOctaves) {
  LatencyCounts counts;
  counts.add(1.01e-4);
  counts.add(2e-4);
  counts.add(2.01e-4);
  const v1::LatencyHistogram histogram = counts.histogram();
  EXPECT_EQ(histogram.counts(1), 2U);
  EXPECT_EQ(histogram.counts(2), 1U);
  EXPECT_DOUBLE_EQ(histogram.sum_seconds(), 5.02e-4);
}

TEST(CallStatistics, CallsAreCountedByStatusAndTimedIfTheyWereWorkedOn) {
  CallStatistics statistics(kStart);
  for (int i = 0; i < 3; ++i) statistics.record(worked(0.01, 0.1, 5), kStart + 10s);
  statistics.record({.method = "RenderGrad",
                     .status = grpc::StatusCode::UNAVAILABLE,
                     .times = std::nullopt,
                     .units = 0,
                     .unit = "paths"},
                    kStart + 10s);
  const v1::MethodStatus method = only_method(statistics, kStart + 20s);
  ASSERT_EQ(method.answers_size(), 2);
  EXPECT_EQ(method.answers(0).status(), "OK");
  EXPECT_EQ(method.answers(0).count(), 3U);
  EXPECT_EQ(method.answers(1).status(), "UNAVAILABLE");
  EXPECT_EQ(method.answers(1).count(), 1U);
  EXPECT_EQ(method.lately_answered(), 3U);
  EXPECT_DOUBLE_EQ(method.lately_per_second(), 3.0 / 20);
  EXPECT_DOUBLE_EQ(method.lately_units_per_second(), 15.0 / 20);
  EXPECT_NEAR(method.lately_work().p99(), 0.1, 0.01);
  EXPECT_NEAR(method.lately_queue().p50(), 0.01, 0.001);
}

TEST(CallStatistics, WhatIsLongAgoIsNotLately) {
  CallStatistics statistics(kStart);
  for (int i = 0; i < 10; ++i) statistics.record(worked(0, 1), kStart + 30s);
  statistics.record(worked(0, 0.01), kStart + 7min);
  const v1::MethodStatus method = only_method(statistics, kStart + 7min + 30s);
  EXPECT_EQ(method.lately_answered(), 1U);
  EXPECT_LT(method.lately_work().p99(), 0.02);
  EXPECT_DOUBLE_EQ(method.lately_per_second(), 1 / 270.0);  // of 4.5 minutes
  EXPECT_EQ(method.work().counts_size(), 26);
  EXPECT_NEAR(method.work().sum_seconds(), 10.01, 1e-9);  // since the start
}

TEST(CallLog, WritesSoManyLinesASecondAndSaysHowManyItLeftOut) {
  CallLog log;
  const CallLog::Clock::time_point start = kStart + 1h;
  uint64_t left_out = 0;
  for (int i = 0; i < CallLog::kLinesPerSecond; ++i) EXPECT_TRUE(log.admits(left_out, start));
  for (int i = 0; i < 7; ++i) EXPECT_FALSE(log.admits(left_out, start + 900ms));
  EXPECT_TRUE(log.admits(left_out, start + 1s));
  EXPECT_EQ(left_out, 7U);
  EXPECT_TRUE(log.admits(left_out, start + 1s));
  EXPECT_EQ(left_out, 0U);
}

}  // namespace
}  // namespace itn
