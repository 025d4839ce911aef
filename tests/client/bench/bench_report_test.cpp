#include "client/bench/bench_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace itn {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;

BenchRow row() {
  BenchRow row;
  row.open_loop = true;
  row.load = 20;
  row.units_per_call = 100;
  row.result.windows = 4;
  row.result.stable = true;
  row.result.last = {.seconds = 2,
                     .latencies = {0.001, 0.002, 0.004, 1.5},
                     .lateness = {0, 0, 0, 0.0001, 0, 0, 0},
                     .refused = 2,
                     .failed = {{"INTERNAL", 1}}};
  return row;
}

TEST(BenchReport, IsATableForPeople) {
  const std::string header = bench_header(BenchFormat::kText, true, "paths");
  const std::string line = bench_line(BenchFormat::kText, row(), "paths");
  EXPECT_THAT(header, HasSubstr("rate   calls/s     paths/s    p50 ms"));
  EXPECT_THAT(line, HasSubstr(" 20      2.00         200      2.00"));
  EXPECT_THAT(line, HasSubstr(" yes        2  INTERNAL 1\n"));
  EXPECT_EQ(header.find("stable") + 6, line.find("yes") + 3) << "below each other";
  EXPECT_EQ(header.find("failed"), line.find("INTERNAL"));
}

TEST(BenchReport, IsCsvWithAFieldForEachName) {
  const std::string header = bench_header(BenchFormat::kCsv, true, "paths");
  const std::string line = bench_line(BenchFormat::kCsv, row(), "paths");
  EXPECT_EQ(std::ranges::count(header, ','), std::ranges::count(line, ','));
  EXPECT_EQ(line, "rate,20,2,200,paths,2,1500,1500,0.1,4,true,4,2,INTERNAL:1\n");
}

TEST(BenchReport, IsAJsonObjectForEachLoad) {
  EXPECT_EQ(bench_header(BenchFormat::kJson, true, "paths"), "");
  EXPECT_EQ(bench_line(BenchFormat::kJson, row(), "paths"),
            "{\"rate\":20,\"calls_per_second\":2,\"units_per_second\":200,\"unit\":\"paths\","
            "\"p50_ms\":2,\"p90_ms\":1500,\"p99_ms\":1500,\"late_p99_ms\":0.1,\"windows\":4,"
            "\"stable\":true,\"seconds\":2,\"ok\":4,\"refused\":2,\"failed\":{\"INTERNAL\":1}}\n");
}

// A time of 0 would be the best of all.
TEST(BenchReport, HasNoLatenciesWhereNothingWasAnswered) {
  BenchRow failed = row();
  failed.result.stable = false;
  failed.result.last.latencies.clear();
  EXPECT_THAT(bench_line(BenchFormat::kText, failed, "paths"),
              ContainsRegex(" 20 +0\\.00 +0\\.00 +- +- +- +0\\.10 +4 +no "));
  EXPECT_EQ(bench_line(BenchFormat::kCsv, failed, "paths"),
            "rate,20,0,0,paths,,,,0.1,4,false,0,2,INTERNAL:1\n");
  EXPECT_THAT(bench_line(BenchFormat::kJson, failed, "paths"),
              HasSubstr("\"p50_ms\":null,\"p90_ms\":null,\"p99_ms\":null,\"late_p99_ms\":0.1,"));
  // Nor any at all where no call has ended.
  failed.result.last.lateness.clear();
  EXPECT_THAT(bench_line(BenchFormat::kCsv, failed, "paths"), HasSubstr("paths,,,,,4"));
}

}  // namespace
}  // namespace itn
