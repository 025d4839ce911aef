// What became of a server's calls, and how long they took.
#pragma once

#include <grpcpp/support/status.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "itn/v1/status.pb.h"

namespace itn {

// Times by their logarithm: quarters of octaves from 0.1 ms on, so that a quantile is known to
// within 10 %.
class LatencyCounts {
 public:
  void add(double seconds);
  void add(const LatencyCounts& other);

  uint64_t count() const { return count_; }
  // The time that a part `p` of them, in (0, 1], does not exceed; 0 if there is none.
  double quantile(double p) const;
  v1::Quantiles quantiles() const;
  // By octaves.
  v1::LatencyHistogram histogram() const;

 private:
  static constexpr size_t kOctaves = 24, kParts = 4;  // up to 28 minutes
  // Those below the first, and those beyond the last.
  std::array<uint64_t, kOctaves * kParts + 2> counts_{};
  uint64_t count_ = 0;
  double sum_ = 0;
};

// One call that was answered.
struct CallRecord {
  std::string_view method;
  grpc::StatusCode status = grpc::StatusCode::OK;
  // Of a call that was worked on.
  struct Times {
    double queue = 0, work = 0;  // in seconds
  };
  std::optional<Times> times;
  double units = 0;  // what was done: of what kind, `unit` says
  std::string_view unit;
};

// Thread-safe. Takes the same memory however many calls there are.
class CallStatistics {
 public:
  using Clock = std::chrono::steady_clock;

  explicit CallStatistics(Clock::time_point start = Clock::now()) : start_(start) {}

  void record(const CallRecord& call, Clock::time_point now = Clock::now());

  // Sets status.methods.
  void describe(v1::ServerStatus& status, Clock::time_point now = Clock::now()) const;

 private:
  // What happened lately is in so many minutes, the newest of which has only begun.
  static constexpr size_t kMinutes = 5;

  struct Minute {
    int64_t number = -1;  // since the start
    LatencyCounts queue, work;
    double units = 0;
  };
  struct Method {
    std::map<grpc::StatusCode, uint64_t> answers;
    LatencyCounts queue, work;
    double units = 0;
    std::string unit;
    std::array<Minute, kMinutes> minutes;
  };

  int64_t minute_of(Clock::time_point now) const;
  v1::MethodStatus describe(const Method& method, Clock::time_point now) const;

  const Clock::time_point start_;
  mutable std::mutex mutex_;
  std::map<std::string, Method, std::less<>> methods_;
};

// As in status.proto, e.g. "NOT_FOUND".
std::string status_name(grpc::StatusCode code);

}  // namespace itn
