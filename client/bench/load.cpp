#include "client/bench/load.h"

#include <algorithm>
#include <utility>

#include "client/render_pool/outcome.h"
#include "common/rpc/call_statistics.h"

namespace itn {
namespace {

// A caller whose call failed waits so long, unless the server says how long.
constexpr std::chrono::milliseconds kPatienceAfterFailure{100};

Load::Clock::duration from_seconds(double seconds) {
  return std::chrono::duration_cast<Load::Clock::duration>(std::chrono::duration<double>(seconds));
}

double in_seconds(Load::Clock::duration time) {
  return std::chrono::duration<double>(time).count();
}

}  // namespace

Load::Load(const LoadOptions& options, StartCall start_call)
    : options_(options),
      start_call_(std::move(start_call)),
      most_outstanding_(options.rate > 0 ? options.max_outstanding : options.callers),
      arrivals_(options.rate, options.distribution, options.seed) {
  if (is_open()) {
    due_.push(next_arrival());
  } else {
    for (size_t i = 0; i < options_.callers; ++i) due_.push(start_);
  }
  pacer_ = std::jthread([this](const std::stop_token& stop) { pace(stop); });
}

Load::~Load() {
  pacer_ = std::jthread();
  stop_.request_stop();
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return outstanding_ == 0 && ending_ == 0; });
}

Load::Clock::time_point Load::next_arrival() {
  return start_ + from_seconds(arrivals_.next());
}

void Load::pace(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    if (due_.empty()) {
      changed_.wait(lock, stop, [this] { return !due_.empty(); });
      continue;
    }
    const Clock::time_point next = due_.top();
    if (Clock::now() < next) {
      changed_.wait_until(lock, stop, next, [&] { return due_.top() < next; });
      continue;
    }
    if (outstanding_ == most_outstanding_) {
      changed_.wait(lock, stop, [this] { return outstanding_ < most_outstanding_; });
      continue;
    }
    due_.pop();
    if (is_open()) due_.push(next_arrival());
    begin(next, lock);
  }
}

void Load::begin(Clock::time_point due, std::unique_lock<std::mutex>& lock) {
  ++outstanding_;
  lock.unlock();
  const Clock::time_point made = Clock::now();
  start_call_(stop_.get_token(),
              [this, due, made](const grpc::Status& status) { ended(status, due, made); });
  lock.lock();
}

void Load::ended(const grpc::Status& status, Clock::time_point due, Clock::time_point made) {
  const Clock::time_point now = Clock::now();
  std::unique_lock lock(mutex_);
  record(status, due, made, now);
  --outstanding_;
  // While the next call begins, that one may end, and be the last that the destructor waits for.
  ++ending_;
  if (!is_open() && !stop_.stop_requested()) {
    if (status.ok()) {
      begin(now, lock);
    } else {
      due_.push(now + retry_after(status).value_or(kPatienceAfterFailure));
    }
  }
  --ending_;
  changed_.notify_all();
}

// Under way, or due and not made.
size_t Load::unfinished(Clock::time_point now) const {
  const double overdue =
      is_open() ? std::max(in_seconds(now - due_.top()), 0.0) * options_.rate : 0;
  return outstanding_ + static_cast<size_t>(overdue);
}

void Load::record(const grpc::Status& status, Clock::time_point due, Clock::time_point made,
                  Clock::time_point now) {
  window_.lateness.push_back(in_seconds(made - due));
  if (status.ok()) {
    window_.latencies.push_back(in_seconds(now - due));
    return;
  }
  window_.last_failure = status;
  if (outcome_of(status) == Outcome::kBusy) {
    ++window_.refused;
  } else {
    ++window_.failed[status_name(status.error_code())];
  }
}

BenchWindow Load::measure(double seconds, size_t least_calls, double most_seconds,
                          const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  changed_.wait_until(lock, stop, window_start_ + from_seconds(seconds), [] { return false; });
  changed_.wait_until(lock, stop, window_start_ + from_seconds(most_seconds),
                      [&] { return window_.ended() >= least_calls; });
  const Clock::time_point now = Clock::now();
  window_.seconds = in_seconds(now - std::exchange(window_start_, now));
  window_.unfinished = unfinished(now);
  return std::exchange(window_, {});
}

}  // namespace itn
