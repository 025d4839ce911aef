#include "common/rpc/job_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "common/error.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

// Before any job has ended.
constexpr double kFirstGuessSeconds = 0.2;
// The most recent job counts so much for the mean.
constexpr double kRecency = 0.2;
constexpr double kLeastRetrySeconds = 0.05;
constexpr double kMostRetrySeconds = 10;
// What no job holds is held by requests that come in and answers that go out.
constexpr double kIdleRetrySeconds = 1;
// A place is kept so much longer than the peer was told to stay away.
constexpr double kGraceFactor = 1.5;
constexpr double kGraceSeconds = 0.5;
// For a peer that will ask again at once.
constexpr double kAtOnceSeconds = 2;
// More peers than this are not told apart.
constexpr size_t kMostPeers = 1024;

std::chrono::steady_clock::time_point after(double seconds) {
  using Clock = std::chrono::steady_clock;
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

Error stopping() {
  return Error(ErrorKind::kUnavailable, "this server is stopping");
}

}  // namespace

JobQueue::JobQueue(int threads, size_t capacity)
    : capacity_(capacity),
      thread_count_(static_cast<size_t>(threads)),
      seconds_per_job_(kFirstGuessSeconds) {
  threads_.reserve(thread_count_);
  for (size_t i = 0; i < thread_count_; ++i) threads_.emplace_back([this] { work(); });
}

JobQueue::~JobQueue() {
  std::deque<Waiting> dropped;
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    stopping_ = true;
    dropped.swap(waiting_);
  }
  work_available_.notify_all();
  for (const Waiting& waiting : dropped) waiting.job.drop();
}

JobQueue::Place JobQueue::admit(const std::string& peer) {
  const std::lock_guard lock(mutex_);
  if (closed_) throw stopping();
  forget_old_notes();
  const auto note =
      std::find_if(notes_.begin(), notes_.end(), [&](const Note& n) { return n.peer == peer; });
  const auto before = static_cast<size_t>(note - notes_.begin());
  if (free_places() > before) {
    if (note != notes_.end()) notes_.erase(note);
    ++admitted_;
    return {*this, peer};
  }
  const double seconds = seconds_until_free(before + 1);
  const auto until = after(kGraceFactor * seconds + kGraceSeconds);
  if (note != notes_.end()) {
    note->until = until;
  } else if (notes_.size() < kMostPeers) {
    notes_.push_back({peer, until});
  }
  throw busy(
      fmt::format("this server is busy: {} run, {} wait, {} arrive, {} connections are to come "
                  "again; come again in {:.2f} s",
                  running_, waiting_.size(), admitted_, notes_.size(), seconds),
      seconds);
}

void JobQueue::submit(Place place, Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (closed_) throw stopping();
    waiting_.push_back({place.peer_, std::move(job)});
    place.queue_ = nullptr;
    --admitted_;
  }
  work_available_.notify_one();
}

void JobQueue::give_back(const std::string& peer, std::optional<double> comes_again_in) {
  const std::lock_guard lock(mutex_);
  --admitted_;
  if (!comes_again_in) return;
  std::erase_if(notes_, [&](const Note& note) { return note.peer == peer; });
  if (notes_.size() >= kMostPeers) return;
  notes_.push_front({peer, after(kGraceFactor * *comes_again_in + kAtOnceSeconds)});
}

void JobQueue::drop_stopped() {
  std::vector<Waiting> dropped;
  {
    const std::lock_guard lock(mutex_);
    const auto first = std::stable_partition(
        waiting_.begin(), waiting_.end(),
        [](const Waiting& waiting) { return !waiting.job.stop.stop_requested(); });
    dropped.assign(std::make_move_iterator(first), std::make_move_iterator(waiting_.end()));
    waiting_.erase(first, waiting_.end());
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
  for (const Waiting& waiting : dropped) waiting.job.drop();
}

void JobQueue::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
}

void JobQueue::drain() {
  std::unique_lock lock(mutex_);
  closed_ = true;
  idle_.wait(lock, [this] { return waiting_.empty() && running_ == 0; });
}

bool JobQueue::drain_for(std::chrono::duration<double> patience) {
  std::unique_lock lock(mutex_);
  closed_ = true;
  return idle_.wait_for(lock, patience, [this] { return waiting_.empty() && running_ == 0; });
}

double JobQueue::seconds_until_next_end() const {
  const std::lock_guard lock(mutex_);
  return running_ == 0 ? kIdleRetrySeconds : seconds_of_ends(1);
}

bool JobQueue::full() const {
  const std::lock_guard lock(mutex_);
  return free_places() == 0;
}

size_t JobQueue::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

size_t JobQueue::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size();
}

size_t JobQueue::free_places() const {
  const size_t places = capacity_ + thread_count_;
  return places - std::min(places, waiting_.size() + running_ + admitted_);
}

double JobQueue::seconds_until_free(size_t places) const {
  const auto ends = static_cast<double>(places - std::min(places, free_places()));
  return seconds_of_ends(ends);
}

double JobQueue::seconds_of_ends(double ends) const {
  return std::clamp(ends * seconds_per_job_ / static_cast<double>(thread_count_),
                    kLeastRetrySeconds, kMostRetrySeconds);
}

void JobQueue::forget_old_notes() {
  const auto now = Clock::now();
  std::erase_if(notes_, [&](const Note& note) { return note.until < now; });
}

JobQueue::Waiting JobQueue::take_next() {
  const auto last_start = [this](const Waiting& waiting) {
    const auto found = last_start_.find(waiting.peer);
    return found == last_start_.end() ? 0 : found->second;
  };
  const auto next = std::min_element(
      waiting_.begin(), waiting_.end(),
      [&](const Waiting& a, const Waiting& b) { return last_start(a) < last_start(b); });
  Waiting taken = std::move(*next);
  waiting_.erase(next);
  if (last_start_.size() >= kMostPeers) last_start_.clear();
  last_start_[taken.peer] = ++started_;
  return taken;
}

void JobQueue::work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_available_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
    if (stopping_) return;
    const Waiting next = take_next();
    ++running_;
    lock.unlock();
    const bool dropped = next.job.stop.stop_requested();
    const auto start = Clock::now();
    dropped ? next.job.drop() : next.job.run();
    const std::chrono::duration<double> took = Clock::now() - start;
    lock.lock();
    if (!dropped) seconds_per_job_ += kRecency * (took.count() - seconds_per_job_);
    --running_;
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
}

}  // namespace itn
