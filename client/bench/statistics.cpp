#include "client/bench/statistics.h"

#include <algorithm>
#include <cmath>

namespace itn {

double percentile(std::span<const double> sorted, double p) {
  if (sorted.empty()) return 0;
  const auto count = static_cast<double>(sorted.size());
  const double rank = std::clamp(std::ceil(p * count), 1.0, count);
  return sorted[static_cast<size_t>(rank) - 1];
}

BenchFigures figures_of(const BenchWindow& window) {
  std::vector<double> latencies = window.latencies;
  std::vector<double> lateness = window.lateness;
  std::ranges::sort(latencies);
  std::ranges::sort(lateness);
  return {.calls_per_second =
              window.seconds > 0 ? static_cast<double>(latencies.size()) / window.seconds : 0,
          .p50 = percentile(latencies, 0.5),
          .p90 = percentile(latencies, 0.9),
          .p99 = percentile(latencies, 0.99),
          .late_p99 = percentile(lateness, 0.99),
          .unfinished = window.unfinished};
}

bool agree(std::span<const BenchFigures> windows, double tolerance) {
  const auto is_steady = [&](double BenchFigures::*figure) {
    double sum = 0;
    for (const BenchFigures& window : windows) sum += window.*figure;
    const double mean = sum / static_cast<double>(windows.size());
    return mean > 0 && std::ranges::all_of(windows, [&](const BenchFigures& window) {
             return std::abs(window.*figure - mean) <= tolerance * mean;
           });
  };
  const auto falls_no_further_behind = [](const BenchFigures& window, const BenchFigures& next) {
    return next.unfinished <= window.unfinished;
  };
  return is_steady(&BenchFigures::calls_per_second) && is_steady(&BenchFigures::p50) &&
         is_steady(&BenchFigures::p99) &&
         (windows.size() < 2 ||
          std::ranges::adjacent_find(windows, falls_no_further_behind) != windows.end());
}

BenchWindow joined(std::span<const BenchWindow> windows) {
  BenchWindow all;
  for (const BenchWindow& window : windows) {
    all.seconds += window.seconds;
    all.latencies.insert(all.latencies.end(), window.latencies.begin(), window.latencies.end());
    all.lateness.insert(all.lateness.end(), window.lateness.begin(), window.lateness.end());
    all.refused += window.refused;
    for (const auto& [status, count] : window.failed) all.failed[status] += count;
    if (!window.last_failure.ok()) all.last_failure = window.last_failure;
    all.unfinished = window.unfinished;
  }
  return all;
}

BenchResult measure_until_stable(const BenchEnd& end, const std::function<BenchWindow()>& measure) {
  std::vector<BenchWindow> last;
  std::vector<BenchFigures> figures;
  size_t measured = 0;
  bool stable = false, answered = true;
  while (!stable && answered && measured < end.max_windows) {
    if (measured++ >= kWindowsThatAgree) {
      last.erase(last.begin());
      figures.erase(figures.begin());
    }
    last.push_back(measure());
    figures.push_back(figures_of(last.back()));
    answered = last.back().answered() > 0 || last.back().ended() == 0;
    stable = figures.size() == kWindowsThatAgree && agree(figures, end.tolerance);
  }
  return {.last = joined(last), .windows = measured, .stable = stable};
}

}  // namespace itn
