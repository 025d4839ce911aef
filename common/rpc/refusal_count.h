// Refusals that a log hears of, but not more often than somebody who reads it wants to.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

namespace itn {

// Thread-safe.
class RefusalCount {
 public:
  using Clock = std::chrono::steady_clock;

  static constexpr std::chrono::seconds kTellEvery{10};

  // Of one more: how many there were since they were told of last, if that is long enough ago.
  std::optional<uint64_t> add(Clock::time_point now = Clock::now()) {
    const std::lock_guard lock(mutex_);
    ++untold_;
    if (told_ && now - *told_ < kTellEvery) return std::nullopt;
    told_ = now;
    return std::exchange(untold_, 0);
  }

 private:
  std::mutex mutex_;
  std::optional<Clock::time_point> told_;  // when last
  uint64_t untold_ = 0;
};

}  // namespace itn
