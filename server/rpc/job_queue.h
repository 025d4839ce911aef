// A bounded queue in front of the threads that work, so that gRPC's own threads never do.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/rpc/status.h"

namespace itn {

// Who asks for work: somebody, by one of their connections.
struct QueueClient {
  std::string who;
  std::string connection;

  bool operator==(const QueueClient&) const = default;
};

// Fair to clients, however often they ask and however much: first to those who ask, then to the
// connections of each.
//  - The waiting job that runs next is of the client that was served least recently, and of their
//    connection that was. A new client counts as served when they came.
//  - While others hold slots, have a reservation or were served by one of the latest jobs, nobody
//    holds more slots than are free, but for two.
//  - A connection that is refused gets a reservation. Slots to wait that become free are kept for
//    reservations in their order, one for all connections of another client, until a little after
//    the time that the client was told to come again: that of their turn. Who is to come again at
//    once goes before all others, if free slots are rare. No thread idles for a client that may
//    never come.
// Thread-safe.
class JobQueue {
 public:
  struct Job {
    std::stop_token stop;
    std::function<void()> run;   // on a thread of the queue
    std::function<void()> drop;  // instead of `run`, if a stop was requested while it waited
  };

  // A slot in the queue, given back when it goes out of scope unless a job was submitted to it.
  class QueueSlot {
   public:
    QueueSlot(JobQueue& queue, QueueClient client) : queue_(&queue), client_(std::move(client)) {}
    QueueSlot(QueueSlot&& other) noexcept
        : queue_(std::exchange(other.queue_, nullptr)), client_(std::move(other.client_)) {}
    QueueSlot(const QueueSlot&) = delete;
    QueueSlot& operator=(const QueueSlot&) = delete;
    QueueSlot& operator=(QueueSlot&&) = delete;
    ~QueueSlot() {
      if (queue_ != nullptr) queue_->give_back(*this, {});
    }

    // Gives it back and keeps it for the same client, who will come again: at once, or after the
    // time that they are told.
    void reserve_for_client(double seconds = 0) {
      std::exchange(queue_, nullptr)->give_back(*this, seconds);
    }

   private:
    friend class JobQueue;
    JobQueue* queue_;
    QueueClient client_;
  };

  // `threads` jobs run at a time while up to `capacity` wait.
  JobQueue(int threads, size_t capacity);
  // Drops the jobs that wait; returns when those that run have ended.
  ~JobQueue();
  JobQueue(const JobQueue&) = delete;
  JobQueue& operator=(const JobQueue&) = delete;

  // Throws StatusError (busy, with the time after which to ask again) if there is no slot for this
  // client, Error (kUnavailable) if the queue is closed.
  QueueSlot admit(const QueueClient& client);

  // The job takes the slot. Throws Error (kUnavailable) if the queue was closed meanwhile; then
  // neither of its functions is called.
  void submit(QueueSlot slot, Job job);

  // Drops the waiting jobs whose stop was requested, on the caller's thread.
  void drop_stopped();

  // Takes no more jobs.
  void close();

  // Takes no more jobs, and returns when those that wait or run have ended; false if they have not
  // within `patience`.
  bool drain_for(std::chrono::duration<double> patience);

  // About how long until a job that runs ends; a second if none does.
  double seconds_until_next_end() const;

  // Jobs that run now, and jobs that were submitted and do not run yet.
  size_t running() const;
  size_t waiting() const;

 private:
  using Clock = std::chrono::steady_clock;

  struct Waiting {
    QueueClient client;
    Job job;
    uint64_t since;  // jobs that had begun when it came
  };
  // A client for whom a slot is kept.
  struct Reservation {
    QueueClient client;
    Clock::time_point until;
  };
  using Reservations = std::deque<Reservation>;
  // Slots of a client: of jobs that run or wait, and those without a job yet.
  struct Held {
    size_t all = 0;
    std::map<std::string, size_t> connections;
  };

  // All of them require the lock.
  size_t free_slots() const;
  size_t clients_ahead(const QueueClient& client, const Reservations::const_iterator& end) const;
  bool has_its_share(const QueueClient& client) const;
  double seconds_of_ends(double ends) const;
  void drop_expired_reservations();
  void take_slot(const QueueClient& client);
  void release_slot(const QueueClient& client);
  bool has_more(const QueueClient& other, const QueueClient& client, size_t by) const;
  StatusError refusal(const QueueClient& client, size_t ahead);
  Waiting take_next();

  // Keeps it for the client if they will come again, in so many seconds.
  void give_back(const QueueSlot& slot, std::optional<double> comes_again_in);
  void work();

  const size_t capacity_;
  const size_t thread_count_;
  mutable std::mutex mutex_;
  std::condition_variable work_available_;
  std::condition_variable idle_;
  std::deque<Waiting> waiting_;
  Reservations reservations_;
  std::map<std::string, Held> held_;  // by who
  // The number of the job that was started last, by client and by connection.
  std::unordered_map<std::string, uint64_t> last_start_, last_start_of_connection_;
  uint64_t started_ = 0;
  std::optional<double> seconds_per_job_;  // recently; none has ended yet
  size_t admitted_ = 0;                    // slots without a job yet
  size_t running_ = 0;
  bool closed_ = false;                // no more jobs
  bool stopping_ = false;              // no more work
  std::vector<std::jthread> threads_;  // last: they use what is above
};

}  // namespace itn
