// Which worker gets which render, and what becomes of a render whose worker fails. Book-keeping
// alone: no threads, no calls, no clock of its own.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <future>
#include <memory>
#include <optional>
#include <random>
#include <stop_token>
#include <string>
#include <vector>

#include "client/render_pool/render_job.h"
#include "client/render_pool/render_times.h"
#include "client/render_pool/worker_connection.h"
#include "common/error.h"

namespace itn {

// Not thread-safe: whoever calls it holds the pool's mutex.
//
// A render waits until a worker takes it; if that one fails, it waits again, before all others.
//  - A worker that has no place is asked again when it says; that is no failure, however often.
//  - A worker that is away, or failed, rests and is asked whether it is there before it gets more.
//  - A worker that gave an answer that cannot be right gets nothing any more.
//  - A render that a worker cannot do goes to the others; it fails when kMost of them cannot, or
//  all.
//  - A render under which a worker vanished, or that reached its deadline, kMost times, is given
//  up.
//  - A render fails when all workers that could do it have failed for a given time.
//  - A render that is late gets a second attempt on a worker that has nothing else to do; the first
//    answer is taken (answers are the same) and the other attempt is cancelled.
class Dispatcher {
 public:
  using Clock = std::chrono::steady_clock;

  static constexpr int kMost = 3;

  struct Statistics {
    uint64_t jobs = 0;             // that succeeded
    uint64_t retries = 0;          // attempts after one that failed
    uint64_t second_attempts = 0;  // at renders that were late
    uint64_t scenes_sent = 0;      // scenes that a worker did not hold
    double cpu_seconds = 0;        // spent by the workers on what succeeded
  };

  struct Job;

  // One render on its way through one worker.
  struct Attempt {
    std::shared_ptr<Job> job;
    size_t worker = 0;
    Clock::time_point started;
    // A worker vanished under this render: before it is blamed for another, that one is to be asked
    // whether it is there.
    bool suspect = false;
    // Behind another one, when their worker was lost.
    bool only_waited = false;
    std::stop_source stop;  // another attempt was first, or the pool is closed

    const RenderJob& render() const;
  };

  // `names` begin messages; empty: nothing is put before them.
  Dispatcher(std::vector<std::string> names, std::chrono::milliseconds give_up_after);

  // The future gets the reply, or throws Error as RenderPool::submit says.
  std::future<v1::RenderGradReply> submit(RenderJob job, Clock::time_point now);

  // The next attempt of a worker, or null and the time until which there can be none unless
  // something happens (max: no such time).
  struct Turn {
    std::shared_ptr<Attempt> attempt;
    Clock::time_point until = Clock::time_point::max();
  };
  Turn next(size_t worker, Clock::time_point now);

  // What became of an attempt. Returns whether the worker is to be asked if it is there, as it was
  // up and is not.
  bool finish(const std::shared_ptr<Attempt>& attempt, Answer answer, Clock::time_point now);

  // How long the worker is to rest before it is asked whether it is there; longer each time until a
  // render succeeds.
  std::chrono::milliseconds take_rest(size_t worker);
  // What it answered.
  void probed(size_t worker, const grpc::Status& status, const v1::Capabilities& capabilities,
              Clock::time_point now);

  bool any_up() const;
  // Whether every worker has said that it is none for us: of another version, or no worker at all.
  bool none_fits() const;
  // Each worker with what is known of its last failure.
  std::string last_failures() const;
  const Statistics& statistics() const { return statistics_; }

  // Cancels all renders; their futures throw Error (kCancelled).
  void close();

 private:
  struct Worker {
    std::string name;
    bool up = false;         // takes renders; otherwise it rests, or has not answered yet
    bool set_aside = false;  // for good
    bool unfit = false;      // as it says itself
    v1::Capabilities capabilities;
    std::chrono::milliseconds rest{0};
    std::chrono::milliseconds back_off{0};             // of a worker that has no place
    Clock::time_point full_until;                      // it has no place
    std::optional<Clock::time_point> failing_since;    // nothing has succeeded since
    std::deque<std::shared_ptr<Attempt>> under_way{};  // the oldest first
    std::string last_failure = "no answer";
  };

  // The worker's name in messages.
  static std::string who(const Worker& worker) {
    return worker.name.empty() ? "the embedded worker" : worker.name;
  }

  std::shared_ptr<Attempt> begin(const std::shared_ptr<Job>& job, size_t worker,
                                 Clock::time_point now);
  bool may_take(size_t worker, const Job& job) const;
  Turn second_attempt(size_t worker, Clock::time_point now);

  void succeed(const Attempt& attempt, v1::RenderGradReply reply, Clock::time_point now);
  void wait_for_place(Worker& worker, const grpc::Status& status, Clock::time_point now);
  void set_aside(Worker& worker, const std::string& reason);
  bool take_down(Worker& worker, const std::string& reason, Clock::time_point now);

  void fail(Job& job, const Error& error);
  void end(Job& job);
  void fail_hopeless(Clock::time_point now);
  std::optional<Error> hopeless(const Job& job, Clock::time_point now) const;

  std::vector<Worker> workers_;
  const std::chrono::milliseconds give_up_after_;
  std::deque<std::shared_ptr<Job>> waiting_;
  RenderTimes times_;
  Statistics statistics_;
  std::optional<Clock::time_point> said_that_it_waits_;
  std::minstd_rand random_{std::random_device{}()};
  bool closed_ = false;
};

}  // namespace itn
