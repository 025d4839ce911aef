#include "common/rpc/job_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "common/error.h"

namespace itn {

JobQueue::JobQueue(int threads, size_t capacity) : capacity_(capacity) {
  threads_.reserve(threads);
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

JobQueue::~JobQueue() {
  std::deque<Job> dropped;
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    stopping_ = true;
    dropped.swap(waiting_);
  }
  work_available_.notify_all();
  for (const Job& job : dropped) job.drop();
}

void JobQueue::submit(Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (closed_) throw Error(ErrorKind::kUnavailable, "this worker is stopping");
    const size_t idle_threads = threads_.size() - running_;
    if (waiting_.size() >= capacity_ + idle_threads) {
      throw Error(
          ErrorKind::kUnavailable,
          fmt::format("this worker is busy: {} renders run, {} wait", running_, waiting_.size()));
    }
    waiting_.push_back(std::move(job));
  }
  work_available_.notify_one();
}

void JobQueue::drop_stopped() {
  std::vector<Job> dropped;
  {
    const std::lock_guard lock(mutex_);
    const auto first = std::stable_partition(waiting_.begin(), waiting_.end(), [](const Job& job) {
      return !job.stop.stop_requested();
    });
    dropped.assign(std::make_move_iterator(first), std::make_move_iterator(waiting_.end()));
    waiting_.erase(first, waiting_.end());
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
  for (const Job& job : dropped) job.drop();
}

void JobQueue::drain() {
  std::unique_lock lock(mutex_);
  closed_ = true;
  idle_.wait(lock, [this] { return waiting_.empty() && running_ == 0; });
}

void JobQueue::work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_available_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
    if (stopping_) return;
    const Job job = std::move(waiting_.front());
    waiting_.pop_front();
    ++running_;
    lock.unlock();
    job.stop.stop_requested() ? job.drop() : job.run();
    lock.lock();
    --running_;
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
}

}  // namespace itn
