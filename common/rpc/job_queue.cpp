#include "common/rpc/job_queue.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <string_view>
#include <utility>

#include "common/error.h"

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
// A place is kept so much longer than the client was told to stay away.
constexpr double kGraceFactor = 1.5;
constexpr double kGraceSeconds = 0.5;
// For a client that will ask again at once.
constexpr double kAtOnceSeconds = 2;
// More clients than this are not told apart.
constexpr size_t kMostClients = 1024;
// Who has so many places more than another may lose one to them, after which they still do not have
// fewer.
constexpr size_t kMargin = 2;

std::chrono::steady_clock::time_point after(double delay) {
  using Clock = std::chrono::steady_clock;
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(delay));
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

JobQueue::Place JobQueue::admit(const QueueClient& client) {
  const std::lock_guard lock(mutex_);
  if (closed_) throw stopping();
  forget_old_notes();
  const auto note = std::ranges::find(notes_, client, &Note::client);
  const size_t kept = kept_places(client, note);
  const bool free = free_places() > kept;
  if (!free && displaced_by(client, kMargin) == waiting_.size()) throw refusal(client, kept + 1);
  if (note != notes_.end()) notes_.erase(note);
  take_place(client);
  ++admitted_;
  if (!free) ++displacing_;
  return {*this, client, !free};
}

void JobQueue::submit(Place place, Job job) {
  std::optional<Waiting> displaced;
  std::optional<StatusError> why;
  {
    const std::lock_guard lock(mutex_);
    if (closed_) throw stopping();
    place.queue_ = nullptr;
    --admitted_;
    if (place.displaces_) --displacing_;
    size_t leaving = waiting_.size();
    // The place has become one of the client's meanwhile.
    if (place.displaces_ && free_places() == 0) leaving = displaced_by(place.client_, kMargin - 1);
    if (leaving < waiting_.size()) {
      const auto it = waiting_.begin() + static_cast<std::ptrdiff_t>(leaving);
      why = refusal(it->client, 1);
      free_place(it->client);
      displaced = std::move(*it);
      waiting_.erase(it);
    }
    waiting_.push_back({place.client_, std::move(job), started_});
  }
  work_available_.notify_one();
  if (displaced) displaced->job.refuse(*why);
}

StatusError JobQueue::refusal(const QueueClient& client, size_t places) {
  const double seconds = seconds_until_free(places);
  const auto until = after(kGraceFactor * seconds + kGraceSeconds);
  if (const auto note = std::ranges::find(notes_, client, &Note::client); note != notes_.end()) {
    note->until = until;
  } else if (notes_.size() < kMostClients) {
    notes_.push_back({client, until});
  }
  return busy(
      fmt::format("this server is busy: {} run, {} wait, {} arrive, {} connections are to come "
                  "again; come again in {:.2f} s",
                  running_, waiting_.size(), admitted_, notes_.size(), seconds),
      seconds);
}

void JobQueue::take_place(const QueueClient& client) {
  Held& held = held_[client.who];
  ++held.all;
  ++held.connections[client.connection];
}

void JobQueue::free_place(const QueueClient& client) {
  const auto held = held_.find(client.who);
  const auto connection = held->second.connections.find(client.connection);
  if (--connection->second == 0) held->second.connections.erase(connection);
  if (--held->second.all == 0) held_.erase(held);
}

bool JobQueue::has_more(const QueueClient& other, const QueueClient& client, size_t by) const {
  const auto places = [this](const QueueClient& of, bool by_connection) -> size_t {
    const auto held = held_.find(of.who);
    if (held == held_.end()) return 0;
    if (!by_connection) return held->second.all;
    const auto connection = held->second.connections.find(of.connection);
    return connection == held->second.connections.end() ? 0 : connection->second;
  };
  const bool same = other.who == client.who;
  return places(other, same) >= places(client, same) + by;
}

// The number of a waiting job, of this client's alone if one is named; if there is none, of how
// many wait.
size_t JobQueue::newest_of_who_has_most(const std::string* of) const {
  const auto places = [this](const Waiting& waiting) {
    const Held& held = held_.at(waiting.client.who);
    return std::pair(held.all, held.connections.at(waiting.client.connection));
  };
  size_t newest = waiting_.size();
  for (size_t i = waiting_.size(); i-- > 0;) {
    const Waiting& waiting = waiting_[i];
    if (of != nullptr && waiting.client.who != *of) continue;
    if (newest < waiting_.size() && waiting.client == waiting_[newest].client) continue;
    if (newest == waiting_.size() || places(waiting) > places(waiting_[newest])) newest = i;
  }
  return newest;
}

// A job of who has most, or else of a connection of the same client's; likewise.
size_t JobQueue::displaced_by(const QueueClient& client, size_t margin) const {
  const size_t none = waiting_.size();
  // Each of those who were admitted so will take one.
  if (displacing_ >= none) return none;
  for (const std::string* of : {static_cast<const std::string*>(nullptr), &client.who}) {
    const size_t newest = newest_of_who_has_most(of);
    if (newest < none && has_more(waiting_[newest].client, client, margin)) return newest;
  }
  return none;
}

void JobQueue::give_back(const Place& place, std::optional<double> comes_again_in) {
  const QueueClient& client = place.client_;
  const std::lock_guard lock(mutex_);
  --admitted_;
  if (place.displaces_) --displacing_;
  free_place(client);
  if (!comes_again_in) return;
  std::erase_if(notes_, [&](const Note& note) { return note.client == client; });
  // Who comes at once finds one that is free; and of connections that ask once and go, none is
  // kept.
  if (*comes_again_in == 0 && free_places() > notes_.size() + 1) return;
  if (notes_.size() >= kMostClients) return;
  notes_.push_front({client, after(kGraceFactor * *comes_again_in + kAtOnceSeconds)});
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
    for (const Waiting& waiting : dropped) free_place(waiting.client);
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

// For those who were noted before `end`, and have not much already: who has does not come before
// who has little, whoever asked first.
size_t JobQueue::kept_places(const QueueClient& client, const Notes::const_iterator& end) const {
  const auto now = Clock::now();
  std::set<std::string_view> others;
  size_t kept = 0;
  for (auto note = notes_.begin(); note != end; ++note) {
    if (note->until < now || has_more(note->client, client, kMargin)) continue;
    if (note->client.who == client.who || others.insert(note->client.who).second) ++kept;
  }
  return std::min(kept, std::max<size_t>(capacity_, 1));
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
  // Who is new comes as if a job of theirs had begun just before the last one when they came.
  const auto last_turn = [](const auto& starts, const std::string& name, uint64_t since) {
    const auto found = starts.find(name);
    return found == starts.end() ? 2 * since : 2 * found->second + 1;
  };
  const auto turn = [&](const Waiting& waiting) {
    return std::pair(
        last_turn(last_start_, waiting.client.who, waiting.since),
        last_turn(last_start_of_connection_, waiting.client.connection, waiting.since));
  };
  const auto next = std::ranges::min_element(waiting_, {}, turn);  // the first of equals
  Waiting taken = std::move(*next);
  waiting_.erase(next);
  ++started_;
  const auto note_start = [this](auto& starts, const std::string& name) {
    if (starts.size() >= kMostClients) starts.clear();
    starts[name] = started_;
  };
  note_start(last_start_, taken.client.who);
  note_start(last_start_of_connection_, taken.client.connection);
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
    free_place(next.client);
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
}

}  // namespace itn
