// A line for every call that a server answers, but not more than a disk can take.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>

#include "common/logging.h"

namespace itn {

// Thread-safe.
class CallLog {
 public:
  using Clock = std::chrono::steady_clock;

  // Lines a second. Of more calls, only their number is told.
  static constexpr int kLinesPerSecond = 50;

  // Whether a line may be written now; `left_out`: how many were not since the last that was.
  bool admits(uint64_t& left_out, Clock::time_point now = Clock::now());

  // Logs it, at level info, unless there are too many.
  void line(const std::string& text, std::span<const LogField> fields);

 private:
  std::mutex mutex_;
  Clock::time_point second_;  // when it began
  int lines_ = 0;             // in it
  uint64_t left_out_ = 0;
};

}  // namespace itn
