#include "client/bench/bench_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <optional>
#include <utility>
#include <vector>

namespace itn {
namespace {

// "UNAVAILABLE 3, INTERNAL 1"
std::string list_of(const BenchWindow& window, const char* between, const char* separator) {
  std::vector<std::string> counts;
  for (const auto& [status, count] : window.failed) {
    counts.push_back(fmt::format("{}{}{}", status, between, count));
  }
  return fmt::format("{}", fmt::join(counts, separator));
}

// Of a window; one without answers has no latencies, and one without calls nothing that was late.
struct Times {
  explicit Times(const BenchWindow& window) {
    const BenchFigures figures = figures_of(window);
    if (window.answered() > 0) p50 = figures.p50, p90 = figures.p90, p99 = figures.p99;
    if (window.ended() > 0) late_p99 = figures.late_p99;
  }

  std::optional<double> p50, p90, p99, late_p99;  // in seconds
};

std::string in_ms(std::optional<double> seconds) {
  return seconds ? fmt::format("{:.{}f}", 1e3 * *seconds, *seconds < 1 ? 2 : 0) : "-";
}

// For machines.
std::string exact_ms(std::optional<double> seconds, const char* none) {
  return seconds ? fmt::format("{:.6g}", 1e3 * *seconds) : none;
}

// Four digits at least.
std::string rate(double value) {
  return value < 1e6 ? fmt::format("{:.{}f}", value, value < 100 ? 2 : 0)
                     : fmt::format("{:.4g}M", value / 1e6);
}

std::string columns(const std::string& load, const std::string& calls, const std::string& units,
                    const std::string& p50, const std::string& p90, const std::string& p99,
                    const std::string& late, const std::string& windows, const std::string& stable,
                    const std::string& refused, const std::string& failed) {
  return fmt::format("{:>11}{:>10}{:>12}{:>10}{:>10}{:>10}{:>12}{:>9}{:>8}{:>9}  {}\n", load, calls,
                     units, p50, p90, p99, late, windows, stable, refused, failed);
}

std::string text_line(const BenchRow& row) {
  const BenchFigures figures = figures_of(row.result.last);
  const Times times(row.result.last);
  const std::string failed = list_of(row.result.last, " ", ", ");
  return columns(fmt::format("{:g}", row.load), rate(figures.calls_per_second),
                 rate(figures.calls_per_second * row.units_per_call), in_ms(times.p50),
                 in_ms(times.p90), in_ms(times.p99), in_ms(times.late_p99),
                 fmt::format("{}", row.result.windows), row.result.stable ? "yes" : "no",
                 fmt::format("{}", row.result.last.refused), failed.empty() ? "-" : failed);
}

std::string csv_line(const BenchRow& row, const std::string& unit) {
  const BenchFigures figures = figures_of(row.result.last);
  const BenchWindow& last = row.result.last;
  const Times times(last);
  return fmt::format("{},{:g},{:.6g},{:.6g},{},{},{},{},{},{},{},{},{},{}\n",
                     row.open_loop ? "rate" : "concurrency", row.load, figures.calls_per_second,
                     figures.calls_per_second * row.units_per_call, unit, exact_ms(times.p50, ""),
                     exact_ms(times.p90, ""), exact_ms(times.p99, ""), exact_ms(times.late_p99, ""),
                     row.result.windows, row.result.stable, last.answered(), last.refused,
                     list_of(last, ":", " "));
}

std::string json_line(const BenchRow& row, const std::string& unit) {
  const BenchFigures figures = figures_of(row.result.last);
  const BenchWindow& last = row.result.last;
  const Times times(last);
  std::vector<std::string> failed;
  for (const auto& [status, count] : last.failed) {
    failed.push_back(fmt::format("\"{}\":{}", status, count));
  }
  return fmt::format(
      "{{\"{}\":{:g},\"calls_per_second\":{:.6g},\"units_per_second\":{:.6g},\"unit\":\"{}\","
      "\"p50_ms\":{},\"p90_ms\":{},\"p99_ms\":{},\"late_p99_ms\":{},"
      "\"windows\":{},\"stable\":{},\"seconds\":{:.6g},\"ok\":{},\"refused\":{},"
      "\"failed\":{{{}}}}}\n",
      row.open_loop ? "rate" : "concurrency", row.load, figures.calls_per_second,
      figures.calls_per_second * row.units_per_call, unit, exact_ms(times.p50, "null"),
      exact_ms(times.p90, "null"), exact_ms(times.p99, "null"), exact_ms(times.late_p99, "null"),
      row.result.windows, row.result.stable, last.seconds, last.answered(), last.refused,
      fmt::join(failed, ","));
}

}  // namespace

std::string bench_header(BenchFormat format, bool open_loop, const std::string& unit) {
  switch (format) {
    case BenchFormat::kCsv:
      return "loop,load,calls_per_second,units_per_second,unit,p50_ms,p90_ms,p99_ms,late_p99_ms,"
             "windows,stable,ok,refused,failed\n";
    case BenchFormat::kJson: return "";
    case BenchFormat::kText: break;
  }
  return columns(open_loop ? "rate" : "concurrency", "calls/s", unit + "/s", "p50 ms", "p90 ms",
                 "p99 ms", "late p99 ms", "windows", "stable", "refused", "failed");
}

std::string bench_line(BenchFormat format, const BenchRow& row, const std::string& unit) {
  switch (format) {
    case BenchFormat::kCsv: return csv_line(row, unit);
    case BenchFormat::kJson: return json_line(row, unit);
    case BenchFormat::kText: break;
  }
  return text_line(row);
}

}  // namespace itn
