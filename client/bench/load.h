// Calls that a server is kept busy with: as many as there are callers (closed loop), or so many a
// second, whatever becomes of them (open loop).
#pragma once

#include <grpcpp/support/status.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <queue>
#include <stop_token>
#include <thread>
#include <vector>

#include "client/bench/arrivals.h"
#include "client/bench/statistics.h"

namespace itn {

struct LoadOptions {
  // Closed loop: so many callers, each of whom calls again when the call before has ended: at once,
  // or, where it was not answered, when the server says, or a little later.
  size_t callers = 1;
  // Open loop, if > 0: so many calls a second. Of those that are due, up to max_outstanding are
  // under way, the others are made when these end.
  double rate = 0;
  ArrivalDistribution distribution = ArrivalDistribution::kConstant;
  uint64_t seed = 0;
  size_t max_outstanding = 1024;
};

// A call's latency counts from when it was due, not from when it was made: calls that were held up
// because the server was slow with those before count for what their callers would have waited
// ("coordinated omission" is to leave that out).
class Load {
 public:
  using Clock = std::chrono::steady_clock;
  using Done = std::function<void(const grpc::Status&)>;
  // Begins a call and returns; `done` is called once, later, on another thread. The call ends soon
  // if a stop is requested.
  using StartCall = std::function<void(const std::stop_token& stop, Done done)>;

  // Begins to call.
  Load(const LoadOptions& options, StartCall start_call);
  // Stops calls that are under way, and returns when they have ended.
  ~Load();
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

  // Of the calls that end from the end of the window before, or the beginning, for so many seconds,
  // and on until there are `least_calls`, but not for longer than `most_seconds`; less if a stop is
  // requested.
  BenchWindow measure(double seconds, size_t least_calls, double most_seconds,
                      const std::stop_token& stop);

 private:
  bool is_open() const { return options_.rate > 0; }
  Clock::time_point next_arrival();
  void pace(const std::stop_token& stop);
  // These with the lock held, which the first gives up for a while.
  void begin(Clock::time_point due, std::unique_lock<std::mutex>& lock);
  size_t unfinished(Clock::time_point now) const;
  void record(const grpc::Status& status, Clock::time_point due, Clock::time_point made,
              Clock::time_point now);
  void ended(const grpc::Status& status, Clock::time_point due, Clock::time_point made);

  const LoadOptions options_;
  const StartCall start_call_;
  const size_t most_outstanding_;
  const Clock::time_point start_ = Clock::now();
  std::stop_source stop_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  Arrivals arrivals_;
  // When calls that were not made yet are due: the next of an open loop, callers who wait.
  std::priority_queue<Clock::time_point, std::vector<Clock::time_point>, std::greater<>> due_;
  size_t outstanding_ = 0;
  size_t ending_ = 0;   // threads in ended()
  BenchWindow window_;  // since window_start_
  Clock::time_point window_start_ = start_;
  std::jthread pacer_;  // last: it uses what is above
};

}  // namespace itn
