#include "common/rpc/call_log.h"

#include <spdlog/spdlog.h>

#include <utility>

namespace itn {

bool CallLog::admits(uint64_t& left_out, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (now - second_ >= std::chrono::seconds(1)) {
    second_ = now;
    lines_ = 0;
  }
  if (lines_ == kLinesPerSecond) {
    ++left_out_;
    return false;
  }
  ++lines_;
  left_out = std::exchange(left_out_, 0);
  return true;
}

void CallLog::line(const std::string& text, std::span<const LogField> fields) {
  uint64_t left_out = 0;
  if (!admits(left_out)) return;
  if (left_out > 0) spdlog::info("{} calls were answered without a line here", left_out);
  log_with_fields(spdlog::level::info, text, fields);
}

}  // namespace itn
