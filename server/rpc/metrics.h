// What a server counts, as text for Prometheus and as a file of it.
#pragma once

#include <grpcpp/support/status.h>

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>

namespace itn {

// One call that was answered.
struct CallRecord {
  std::string_view method;
  grpc::StatusCode status = grpc::StatusCode::OK;
  // The times of a call that was worked on.
  struct Times {
    double queue = 0, work = 0;  // in seconds
  };
  std::optional<Times> times;
  double units = 0;  // what was done: of what kind, `unit` says
  std::string_view unit;
};

// The first place counts times up to 0.1 ms, each further one those up to twice the time before,
// the last one all that are longer.
struct LatencyHistogram {
  std::array<uint64_t, 26> counts{};
  double sum = 0;  // in seconds

  void add(double seconds);
};

// Thread-safe. Takes the same memory however many calls there are.
class CallCounts {
 public:
  struct Method {
    std::map<grpc::StatusCode, uint64_t> answers;
    LatencyHistogram queue, work;  // of calls that were worked on: until then, and from then on
    double units = 0;
    std::string unit;
  };
  using Methods = std::map<std::string, Method, std::less<>>;

  void record(const CallRecord& call);
  Methods methods() const;

 private:
  mutable std::mutex mutex_;
  Methods methods_;
};

// Each part of a server sets what it knows.
struct ServerMetrics {
  std::string service;  // full name, e.g. "itn.v1.RenderService"
  double uptime_seconds = 0;
  bool draining = false;
  uint64_t running = 0, max_running = 0, waiting = 0, max_waiting = 0;  // calls
  uint64_t resident_bytes = 0, max_resident_bytes = 0;  // of the process; at most 0: no limit
  uint64_t allocated_bytes = 0;                         // of the heap, and not freed
  uint64_t scene_bytes = 0, scene_hits = 0, scene_misses = 0;
  uint64_t connections = 0, max_connections = 0;
  CallCounts::Methods methods;
};

// In Prometheus' text format 0.0.4: times in seconds, memory in bytes, counters since the start.
// Every sample has the label server="`server`", by which those of several servers of a machine
// differ.
std::string prometheus_text(const ServerMetrics& metrics, const std::string& server);

// Throws Error (kIo) if a MetricsFile of this path would: it cannot be written, or is no file that
// can be replaced.
void check_metrics_file(const std::filesystem::path& path);

// For node_exporter's textfile collector. Written at once, then again and again, and a last time at
// the end; whole at any time.
class MetricsFile {
 public:
  // `server`: as prometheus_text(). Throws Error as check_metrics_file(); later, that is logged,
  // once until it can be written again.
  MetricsFile(std::filesystem::path path, std::string server,
              std::chrono::duration<double> interval, std::function<ServerMetrics()> metrics);
  ~MetricsFile();

 private:
  void write() const;
  void keep_writing(const std::stop_token& stop);

  const std::filesystem::path path_;
  const std::string server_;
  const std::chrono::duration<double> interval_;
  const std::function<ServerMetrics()> metrics_;
  bool failed_ = false;
  std::mutex mutex_;
  std::condition_variable_any never_;
  std::jthread writer_;  // last: it uses what is above
};

}  // namespace itn
