// A bounded queue in front of the threads that render, so that gRPC's own threads never do.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

namespace itn {

// Thread-safe.
class JobQueue {
 public:
  struct Job {
    std::stop_token stop;
    std::function<void()> run;   // on a thread of the queue
    std::function<void()> drop;  // instead of `run`, if a stop was requested while it waited
  };

  // `threads` jobs run at a time while up to `capacity` wait.
  JobQueue(int threads, size_t capacity);
  // Drops the jobs that wait; returns when those that run have ended.
  ~JobQueue();
  JobQueue(const JobQueue&) = delete;
  JobQueue& operator=(const JobQueue&) = delete;

  // Throws Error (kUnavailable) if the queue is full or closed; then the job is not kept and
  // neither of its functions is called.
  void submit(Job job);

  // Drops the waiting jobs whose stop was requested, on the caller's thread.
  void drop_stopped();

  // Takes no more jobs, and returns when those that wait or run have ended.
  void drain();

 private:
  void work();

  const size_t capacity_;
  std::mutex mutex_;
  std::condition_variable work_available_;
  std::condition_variable idle_;
  std::deque<Job> waiting_;
  size_t running_ = 0;
  bool closed_ = false;                // no more jobs
  bool stopping_ = false;              // no more work
  std::vector<std::jthread> threads_;  // last: they use what is above
};

}  // namespace itn
