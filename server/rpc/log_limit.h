// Lines of a log that others may cause, but no more than a disk can take or a reader wants.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

namespace itn {

// Thread-safe.
class LogLimit {
 public:
  using Clock = std::chrono::steady_clock;

  LogLimit(int lines, Clock::duration interval) : lines_(lines), interval_(interval) {}

  // How many lines were left out since the last one, if another may be written now.
  std::optional<uint64_t> admit(Clock::time_point now = Clock::now()) {
    const std::lock_guard lock(mutex_);
    if (!began_ || now - *began_ >= interval_) {
      began_ = now;
      written_ = 0;
    }
    if (written_ == lines_) {
      ++left_out_;
      return std::nullopt;
    }
    ++written_;
    return std::exchange(left_out_, 0);
  }

 private:
  const int lines_;
  const Clock::duration interval_;
  std::mutex mutex_;
  std::optional<Clock::time_point> began_;  // the interval
  int written_ = 0;                         // in it
  uint64_t left_out_ = 0;
};

}  // namespace itn
