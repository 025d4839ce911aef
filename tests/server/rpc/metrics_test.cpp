#include "server/rpc/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <sstream>
#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::HasSubstr;
using testing::TemporaryFolder;

CallRecord worked(double queue, double work) {
  return {.method = "RenderGrad",
          .status = grpc::StatusCode::OK,
          .times = CallRecord::Times{.queue = queue, .work = work},
          .units = 100,
          .unit = "paths"};
}

ServerMetrics busy() {
  CallCounts counts;
  for (const double work : {0.001, 0.02, 3000.0}) counts.record(worked(0.5, work));
  ServerMetrics metrics;
  metrics.service = "itn.v1.RenderService";
  metrics.running = 1;
  metrics.resident_bytes = 1 << 20;
  metrics.allocated_bytes = 1 << 19;
  metrics.scene_hits = 7;
  metrics.scene_misses = 2;
  metrics.connections = 3;
  metrics.max_connections = 1024;
  metrics.methods = counts.methods();
  return metrics;
}

// A reader of the format, strict where it is: every sample belongs to the family before it, and no
// family comes twice.
struct Parsed {
  std::map<std::string, std::string> types;
  std::map<std::string, double> samples;  // by name and labels
};

Parsed parse(const std::string& text) {
  static const std::regex kSample(
      R"re(([a-z_]+)(\{[a-z]+="[^"]*"(?:,[a-z]+="[^"]*")*\})? ([-+.e0-9]+))re");
  Parsed parsed;
  std::istringstream lines(text);
  std::string family;
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (line.starts_with("# HELP ")) continue;
    if (line.starts_with("# TYPE ")) {
      std::istringstream words(line.substr(7));
      std::string type;
      words >> family >> type;
      EXPECT_TRUE(parsed.types.emplace(family, type).second) << line;
    } else if (std::regex_match(line, match, kSample)) {
      std::string name = match[1];
      if (parsed.types[family] == "histogram") {
        name = std::regex_replace(name, std::regex("_(bucket|sum|count)$"), "");
      }
      EXPECT_EQ(name, family) << line;
      EXPECT_TRUE(
          parsed.samples.emplace(match[1].str() + match[2].str(), std::stod(match[3])).second)
          << line;
    } else {
      ADD_FAILURE() << line;
    }
  }
  EXPECT_TRUE(text.ends_with("\n"));
  return parsed;
}

TEST(LatencyHistogram, IsByOctaves) {
  LatencyHistogram histogram;
  for (const double seconds : {0.0, 1e-9, 1e-4, 1.01e-4, 2e-4, 2.01e-4, 1e9}) {
    histogram.add(seconds);
  }
  EXPECT_EQ(histogram.counts[0], 3U);
  EXPECT_EQ(histogram.counts[1], 2U);
  EXPECT_EQ(histogram.counts[2], 1U);
  EXPECT_EQ(histogram.counts[25], 1U);
  EXPECT_DOUBLE_EQ(histogram.sum, 1e9 + 6.02e-4);
}

TEST(CallCounts, CountsCallsByStatusAndTimesThoseThatWereWorkedOn) {
  CallCounts counts;
  for (int i = 0; i < 3; ++i) counts.record(worked(0.01, 0.1));
  counts.record({.method = "RenderGrad",
                 .status = grpc::StatusCode::UNAVAILABLE,
                 .times = std::nullopt,
                 .units = 0,
                 .unit = "paths"});
  const CallCounts::Methods methods = counts.methods();
  ASSERT_EQ(methods.size(), 1U);
  const CallCounts::Method& method = methods.at("RenderGrad");
  EXPECT_EQ(method.answers.at(grpc::StatusCode::OK), 3U);
  EXPECT_EQ(method.answers.at(grpc::StatusCode::UNAVAILABLE), 1U);
  EXPECT_DOUBLE_EQ(method.queue.sum, 0.03);
  EXPECT_DOUBLE_EQ(method.work.sum, 0.3);
  EXPECT_EQ(method.units, 300);
}

TEST(PrometheusText, IsPrometheusText) {
  Parsed parsed = parse(prometheus_text(busy(), "127.0.0.1:5"));
  EXPECT_EQ(parsed.types["itn_calls_total"], "counter");
  EXPECT_EQ(parsed.types["itn_work_seconds"], "histogram");
  const std::string server = "server=\"127.0.0.1:5\"";
  const std::string method = server + ",method=\"RenderGrad\"";
  EXPECT_EQ(parsed.samples["itn_calls_total{" + method + ",status=\"OK\"}"], 3);
  EXPECT_EQ(parsed.samples["itn_work_units_total{" + method + ",unit=\"paths\"}"], 300);
  EXPECT_EQ(parsed.samples["itn_work_seconds_count{" + method + "}"], 3);
  EXPECT_EQ(parsed.samples["itn_work_seconds_bucket{" + method + ",le=\"0.0008\"}"], 0);
  EXPECT_EQ(parsed.samples["itn_work_seconds_bucket{" + method + ",le=\"0.0016\"}"], 1);
  EXPECT_EQ(parsed.samples["itn_work_seconds_bucket{" + method + ",le=\"0.0256\"}"], 2);
  EXPECT_EQ(parsed.samples["itn_work_seconds_bucket{" + method + ",le=\"+Inf\"}"], 3);
  EXPECT_DOUBLE_EQ(parsed.samples["itn_work_seconds_sum{" + method + "}"], 3000.021);
  EXPECT_EQ(parsed.samples["itn_resident_memory_bytes{" + server + "}"], 1 << 20);
  EXPECT_EQ(parsed.samples["itn_allocated_memory_bytes{" + server + "}"], 1 << 19);
  EXPECT_EQ(parsed.types["itn_scene_hits_total"], "counter");
  EXPECT_EQ(parsed.samples["itn_scene_hits_total{" + server + "}"], 7);
  EXPECT_EQ(parsed.samples["itn_scene_misses_total{" + server + "}"], 2);
  EXPECT_EQ(parsed.samples["itn_connections{" + server + "}"], 3);
  EXPECT_EQ(parsed.samples["itn_connections_max{" + server + "}"], 1024);
}

// Whoever draws them has these names.
TEST(PrometheusText, KeepsItsNames) {
  std::string names;
  for (const auto& [name, type] : parse(prometheus_text(busy(), "")).types) {
    names += name + " " + type + "\n";
  }
  EXPECT_EQ(names, R"(itn_allocated_memory_bytes gauge
itn_calls_running gauge
itn_calls_running_max gauge
itn_calls_total counter
itn_calls_waiting gauge
itn_calls_waiting_max gauge
itn_connections gauge
itn_connections_max gauge
itn_draining gauge
itn_info gauge
itn_queue_seconds histogram
itn_resident_memory_bytes gauge
itn_resident_memory_max_bytes gauge
itn_scene_hits_total counter
itn_scene_memory_bytes gauge
itn_scene_misses_total counter
itn_uptime_seconds gauge
itn_work_seconds histogram
itn_work_units_total counter
)");
}

TEST(PrometheusText, OfAServerThatNobodyHasCalled) {
  EXPECT_EQ(
      parse(prometheus_text(ServerMetrics(), "")).samples.count("itn_calls_running{server=\"\"}"),
      1U);
}

TEST(MetricsFile, IsThereAtOnceAndAtTheEnd) {
  const TemporaryFolder folder;
  const std::string path = folder.path("itn.prom");
  ServerMetrics metrics = busy();
  const auto content = [&] {
    std::ifstream file(path);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  {
    const MetricsFile file(path, "a", std::chrono::hours(1), [&] { return metrics; });
    EXPECT_THAT(content(), HasSubstr("itn_calls_running{server=\"a\"} 1\n"));
    metrics.running = 4;
  }
  EXPECT_THAT(content(), HasSubstr("itn_calls_running{server=\"a\"} 4\n"));
}

TEST(MetricsFile, SaysAtOnceThatItCannotBeWritten) {
  const TemporaryFolder folder;
  testing::expect_error(ErrorKind::kIo, {"itn.prom"}, [&] {
    const MetricsFile file(folder.path("nowhere/itn.prom"), "a", std::chrono::hours(1), busy);
  });
  // Nor is anything that would be written into rather than replaced, or that waits for a reader.
  const std::string fifo = folder.path("fifo");
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  for (const std::string& path : {std::string("-"), fifo}) {
    testing::expect_error(ErrorKind::kIo, {"regular file"}, [&] { check_metrics_file(path); });
  }
}

}  // namespace
}  // namespace itn
