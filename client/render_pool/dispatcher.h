// Which worker gets which render, and what becomes of a render whose worker fails. Book-keeping
// alone: no threads, no calls, no clock of its own.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <stop_token>
#include <string>
#include <vector>

#include "client/render/render_job.h"
#include "client/render_pool/render_statistics.h"
#include "client/render_pool/render_times.h"
#include "client/render_pool/render_worker.h"
#include "common/error.h"

namespace itn {

// Not thread-safe: whoever calls it holds the pool's mutex.
//
// A render waits until a worker takes it; if that one fails, it waits again, before all others.
//  - A worker that has no place is asked again when it says; that is no failure, however often.
//  - A worker that is away, or failed, rests and is asked whether it is there before it gets more.
//  - A worker that gave an answer that cannot be right gets nothing any more.
//  - A render that a worker cannot do goes to the others; it fails when kMaxFailures of them
//    cannot, or all.
//  - A render under which a worker vanished, or that reached its deadline, kMaxFailures times, is
//    given up; attempts that are lost together count once.
//  - A render fails when all workers that could do it have failed for a given time.
//  - A render that is late gets a second attempt (a hedge) on a worker that has nothing else to do;
//  the first
//    answer is taken (answers are the same) and the other attempt is cancelled.
//  - A worker may join at any time, or leave: what is under way there goes on. Without any worker,
//    renders wait for one to join.
//
// No decision takes longer the more workers there are, unless some of them fail.
class Dispatcher {
 public:
  using Clock = std::chrono::steady_clock;

  static constexpr int kMaxFailures = 3;

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
    std::chrono::milliseconds deadline{};  // RenderTimes; zero: none is known
    uint64_t number = 0;                   // in the order in which attempts begin
    std::stop_source stop;                 // another attempt was first, or the pool is closed

    const RenderJob& render() const;
  };

  explicit Dispatcher(std::chrono::milliseconds give_up_after) : give_up_after_(give_up_after) {}

  // A worker that joins, and its number, which no other ever has. `name` begins messages; empty:
  // nothing is put before them.
  size_t add(std::string name);
  // One that leaves: but for `finish`, its number is not to be used any more.
  void remove(size_t worker, Clock::time_point now);

  // The future gets the reply, or throws Error as RenderPool::submit says.
  std::future<v1::RenderGradReply> submit(RenderJob job, Clock::time_point now);

  // The next attempt of a worker, or null and the time until which it has no place (max: it has,
  // and there is nothing for it).
  struct Turn {
    std::shared_ptr<Attempt> attempt;
    Clock::time_point until = Clock::time_point::max();
  };
  Turn next(size_t worker, Clock::time_point now);
  // Whether a render waits that this worker may take.
  bool has_render_for(size_t worker, Clock::time_point now) const;
  size_t waiting() const { return waiting_.size(); }

  // How many renders are late and have one attempt alone, and when there will be one more (max: not
  // of those that have begun).
  struct Stragglers {
    size_t count = 0;
    Clock::time_point next = Clock::time_point::max();
  };
  Stragglers stragglers(Clock::time_point now) const;

  // What became of an attempt. Returns whether the worker is to be asked if it is there: it was
  // connected, and is not any more.
  bool finish(const std::shared_ptr<Attempt>& attempt, Answer answer, Clock::time_point now);

  // How long the worker is to rest before it is asked whether it is there; longer each time until a
  // render succeeds.
  std::chrono::milliseconds next_probe_delay(size_t worker);
  // What it answered.
  void on_probe(size_t worker, const grpc::Status& status, const v1::Capabilities& capabilities,
                Clock::time_point now);

  bool any_connected() const;
  // Whether there is any that has not left, connected or not.
  bool has_workers() const;
  // Whether there are workers, and each has answered that it takes no renders of ours: of another
  // version, none at all, or with another token.
  bool all_refuse() const;
  // Each worker with what is known of its last failure.
  std::string last_failures() const;
  const RenderStatistics& statistics() const { return statistics_; }

  // Cancels all renders; their futures throw Error (kCancelled).
  void close();

 private:
  struct Worker {
    std::string name;
    bool connected = false;       // takes renders; otherwise it rests, or has not answered yet
    bool excluded = false;        // for good
    bool incompatible = false;    // as it says itself
    bool refuses = false;         // likewise, or it wants another token
    bool left = false;            // is no more when nothing of it is under way
    bool never_connected = true;  // and nobody was told
    bool only_lost = false;       // it was taken down for a lost render, and has not answered since
    v1::Capabilities capabilities;
    std::chrono::milliseconds probe_delay{0};
    std::chrono::milliseconds busy_delay{0};           // of a worker that has no place
    Clock::time_point full_until;                      // it has no place
    std::optional<Clock::time_point> failing_since;    // nothing has succeeded since
    std::deque<std::shared_ptr<Attempt>> under_way{};  // the oldest first
    std::string last_failure = "no answer";
  };

  // The worker's name in messages.
  static std::string label(const Worker& worker) {
    return worker.name.empty() ? "the embedded worker" : worker.name;
  }

  using Waiting = std::deque<std::shared_ptr<Job>>;

  Waiting::const_iterator first_for(size_t worker) const;
  std::shared_ptr<Attempt> begin(const std::shared_ptr<Job>& job, size_t worker,
                                 Clock::time_point now);
  bool may_take(size_t worker, const Job& job) const;
  Turn hedge(size_t worker, Clock::time_point now);
  bool on_outcome(const std::shared_ptr<Attempt>& attempt, Answer answer, Clock::time_point now);

  static void note_loss(const Attempt& attempt, const std::string& what, Clock::time_point now);
  void succeed(const Attempt& attempt, v1::RenderGradReply reply, Clock::time_point now);
  void wait_for_place(Worker& worker, const grpc::Status& status, Clock::time_point now);
  void exclude(Worker& worker, const std::string& reason);
  bool take_down(Worker& worker, const std::string& reason, Clock::time_point now);

  void fail(Job& job, const Error& error);
  void end(Job& job);
  void fail_unservable(Clock::time_point now);
  std::optional<Error> unservable(const Job& job, Clock::time_point now) const;

  std::map<size_t, Worker> workers_;
  size_t next_worker_ = 0;
  const std::chrono::milliseconds give_up_after_;
  Waiting waiting_;
  std::map<uint64_t, std::shared_ptr<Attempt>> under_way_;  // by number: the oldest first
  uint64_t next_attempt_ = 0;
  RenderTimes times_;
  RenderStatistics statistics_;
  std::optional<Clock::time_point> last_wait_notice_;
  std::minstd_rand random_{std::random_device{}()};
  bool closed_ = false;
};

}  // namespace itn
