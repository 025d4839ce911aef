#include "client/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

namespace itn {

namespace {

constexpr std::chrono::milliseconds kTerminalInterval(100);
constexpr std::chrono::seconds kPlainInterval(10);
std::atomic<bool> silent = false;

}  // namespace

std::string format_duration(std::chrono::seconds duration) {
  const auto s = duration.count();
  if (s < 60) return fmt::format("{} s", s);
  if (s < 3600) return fmt::format("{}:{:02}", s / 60, s % 60);
  return fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
}

void silence_progress() {
  silent = true;
}

Progress::Progress(std::string label, std::string unit, uint64_t total, uint64_t done,
                   std::FILE* out)
    : label_(std::move(label)),
      unit_(std::move(unit)),
      total_(total),
      first_(done),
      done_(done),
      out_(out),
      terminal_(::isatty(::fileno(out)) == 1) {}

Progress::~Progress() {
  if (line_begun_) std::fputc('\n', out_);
}

void Progress::update(uint64_t done, const std::string& note) {
  done_ = done;
  note_ = note;
  const auto now = Clock::now();
  if (finished_ || now - shown_ < (terminal_ ? Clock::duration(kTerminalInterval)
                                             : Clock::duration(kPlainInterval))) {
    return;
  }
  show(now);
}

void Progress::end_within(double seconds) {
  end_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                            std::chrono::duration<double>(std::max(0.0, seconds)));
}

void Progress::finish() {
  if (std::exchange(finished_, true)) return;
  show(Clock::now());
  if (std::exchange(line_begun_, false)) std::fputc('\n', out_);
}

std::string Progress::line(Clock::time_point now) const {
  const double seconds = std::chrono::duration<double>(now - start_).count();
  const double rate = seconds > 0 ? static_cast<double>(done_ - first_) / seconds : 0;
  std::string text = fmt::format("{} {}/{} {}", label_, done_, total_, unit_);
  if (total_ > 0) {
    text +=
        fmt::format("  {:.0f}%", 100 * static_cast<double>(done_) / static_cast<double>(total_));
  }
  if (rate > 0) text += fmt::format("  {:.3g} {}/s", rate, unit_);
  const auto whole = [](double s) { return std::chrono::seconds(std::llround(s)); };
  if (finished_) {
    text += fmt::format("  {} in all", format_duration(whole(seconds)));
  } else if (rate > 0 && total_ >= done_) {
    double left = static_cast<double>(total_ - done_) / rate;
    const double to_end = end_ ? std::chrono::duration<double>(*end_ - now).count()
                               : std::numeric_limits<double>::max();
    const bool is_limited = to_end < left;
    if (is_limited) left = std::max(0.0, to_end);
    text += fmt::format("  {}{} left", is_limited ? "at most " : "", format_duration(whole(left)));
  }
  if (!note_.empty()) text += "  " + note_;
  return text;
}

void Progress::show(Clock::time_point now) {
  if (silent) return;
  shown_ = now;
  const std::string text = line(now);
  if (terminal_) {
    // Carriage return, the line, erase what is left of a longer one.
    fmt::print(out_, "\r{}\x1b[K", text);
    line_begun_ = true;
  } else {
    fmt::print(out_, "{}\n", text);
  }
  std::fflush(out_);
}

}  // namespace itn
