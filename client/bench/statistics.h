// What the calls of a benchmark took, and when enough was measured.
#pragma once

#include <grpcpp/support/status.h>

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace itn {

// The least of the values, which are sorted, that a part `p` of them, in (0, 1], does not exceed; 0
// if there is none.
double percentile(std::span<const double> sorted, double p);

// Calls that ended within some time; all times in seconds.
struct BenchWindow {
  double seconds = 0;
  // Of calls that were answered OK, from when they were meant to be made to the answer.
  std::vector<double> latencies;
  // Of all calls: from when they were meant to be made to when they were.
  std::vector<double> lateness;
  uint64_t refused = 0;                    // the server was busy and said when to come again
  std::map<std::string, uint64_t> failed;  // all others that were not OK, by status
  grpc::Status last_failure{};             // of the last call that was not OK, if there was one

  uint64_t unfinished = 0;  // at its end: calls under way, or due and not made

  uint64_t answered() const { return latencies.size(); }
  uint64_t ended() const { return lateness.size(); }
};

// Of a window.
struct BenchFigures {
  double calls_per_second = 0;       // answered OK
  double p50 = 0, p90 = 0, p99 = 0;  // of their latencies, in seconds
  double late_p99 = 0;               // of the lateness, in seconds
  uint64_t unfinished = 0;
};

BenchFigures figures_of(const BenchWindow& window);

// Whether throughput, p50 and p99 of each are within a part `tolerance` of their means over all.
// Not where nothing was answered, or where each leaves more calls unfinished than the one before:
// more is asked of the server than it can do, and latencies grow for as long as one looks.
bool agree(std::span<const BenchFigures> windows, double tolerance);

// As one.
BenchWindow joined(std::span<const BenchWindow> windows);

// So many windows in a row must agree, and make the result together, as those of Triton's
// perf_analyzer.
inline constexpr size_t kWindowsThatAgree = 3;

struct BenchEnd {
  double tolerance = 0.1;  // of agree()
  size_t max_windows = 10;
};

struct BenchResult {
  BenchWindow last;    // the last kWindowsThatAgree together, or as many as there are
  size_t windows = 0;  // measured
  bool stable = false;
};

// Measures windows until the last ones agree, there are max_windows, or in one of them calls ended
// and none of them was answered.
BenchResult measure_until_stable(const BenchEnd& end, const std::function<BenchWindow()>& measure);

}  // namespace itn
