#include "client/bench/bench_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace itn {
namespace {

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
  const std::string header = bench_header(BenchFormat::kText, true, "samples");
  const std::string line = bench_line(BenchFormat::kText, row(), "samples");
  EXPECT_THAT(header, HasSubstr("rate   calls/s   samples/s    p50 ms"));
  EXPECT_THAT(line, HasSubstr(" 20      2.00         200      2.00"));
  EXPECT_THAT(line, HasSubstr(" yes        2  INTERNAL 1\n"));
  EXPECT_EQ(header.find("stable") + 6, line.find("yes") + 3) << "below each other";
  EXPECT_EQ(header.find("failed"), line.find("INTERNAL"));
}

TEST(BenchReport, IsCsvWithAFieldForEachName) {
  const std::string header = bench_header(BenchFormat::kCsv, true, "samples");
  const std::string line = bench_line(BenchFormat::kCsv, row(), "samples");
  EXPECT_EQ(std::ranges::count(header, ','), std::ranges::count(line, ','));
  EXPECT_EQ(line, "rate,20,2,200,samples,2,1500,1500,0.1,4,true,4,2,INTERNAL:1\n");
}

TEST(BenchReport, IsAJsonObjectForEachLoad) {
  EXPECT_EQ(bench_header(BenchFormat::kJson, true, "samples"), "");
  EXPECT_EQ(bench_line(BenchFormat::kJson, row(), "samples"),
            "{\"rate\":20,\"calls_per_second\":2,\"units_per_second\":200,\"unit\":\"samples\","
            "\"p50_ms\":2,\"p90_ms\":1500,\"p99_ms\":1500,\"late_p99_ms\":0.1,\"windows\":4,"
            "\"stable\":true,\"seconds\":2,\"ok\":4,\"refused\":2,\"failed\":{\"INTERNAL\":1}}\n");
}

}  // namespace
}  // namespace itn
