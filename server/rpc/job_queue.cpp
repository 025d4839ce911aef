#include "server/rpc/job_queue.h"

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
constexpr double kMinRetrySeconds = 0.05;
constexpr double kMaxRetrySeconds = 10;
// What no job holds is held by requests that come in and answers that go out.
constexpr double kIdleRetrySeconds = 1;
// A slot is kept so much longer than the client was told to stay away.
constexpr double kGraceFactor = 1.5;
constexpr double kGraceSeconds = 0.5;
// For a client that will ask again at once.
constexpr double kAtOnceSeconds = 2;
// More clients than this are not told apart.
constexpr size_t kMaxClients = 1024;
// Who has so many slots more than another does not come before them; as many, where they are free,
// anybody may have.
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
    : capacity_(capacity), thread_count_(static_cast<size_t>(threads)) {
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

JobQueue::QueueSlot JobQueue::admit(const QueueClient& client) {
  const std::lock_guard lock(mutex_);
  if (closed_) throw stopping();
  drop_expired_reservations();
  const auto reservation = std::ranges::find(reservations_, client, &Reservation::client);
  const size_t ahead = clients_ahead(client, reservation);
  const size_t kept = std::min(ahead, std::max<size_t>(capacity_, 1));
  if (free_slots() <= kept || has_its_share(client)) throw refusal(client, ahead);
  if (reservation != reservations_.end()) reservations_.erase(reservation);
  take_slot(client);
  ++admitted_;
  return {*this, client};
}

void JobQueue::submit(QueueSlot slot, Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (closed_) throw stopping();
    slot.queue_ = nullptr;
    --admitted_;
    waiting_.push_back({slot.client_, std::move(job), started_});
  }
  work_available_.notify_one();
}

// Told the time of their turn: when those ahead of them, and they, have slots.
StatusError JobQueue::refusal(const QueueClient& client, size_t ahead) {
  const size_t ends = ahead + 1 - std::min(ahead, free_slots());
  const double seconds = seconds_of_ends(static_cast<double>(ends));
  const auto until = after(kGraceFactor * seconds + kGraceSeconds);
  if (const auto reservation = std::ranges::find(reservations_, client, &Reservation::client);
      reservation != reservations_.end()) {
    reservation->until = until;
  } else if (reservations_.size() < kMaxClients) {
    reservations_.push_back({client, until});
  }
  return busy(
      fmt::format("this server is busy: {} run, {} wait, {} arrive, {} connections are to come "
                  "again; come again in {:.2f} s",
                  running_, waiting_.size(), admitted_, reservations_.size(), seconds),
      seconds);
}

void JobQueue::take_slot(const QueueClient& client) {
  Held& held = held_[client.who];
  ++held.all;
  ++held.connections[client.connection];
}

void JobQueue::release_slot(const QueueClient& client) {
  const auto held = held_.find(client.who);
  const auto connection = held->second.connections.find(client.connection);
  if (--connection->second == 0) held->second.connections.erase(connection);
  if (--held->second.all == 0) held_.erase(held);
}

bool JobQueue::has_more(const QueueClient& other, const QueueClient& client, size_t by) const {
  const auto slots = [this](const QueueClient& of, bool by_connection) -> size_t {
    const auto held = held_.find(of.who);
    if (held == held_.end()) return 0;
    if (!by_connection) return held->second.all;
    const auto connection = held->second.connections.find(of.connection);
    return connection == held->second.connections.end() ? 0 : connection->second;
  };
  const bool same = other.who == client.who;
  return slots(other, same) >= slots(client, same) + by;
}

void JobQueue::give_back(const QueueSlot& slot, std::optional<double> comes_again_in) {
  const QueueClient& client = slot.client_;
  const std::lock_guard lock(mutex_);
  --admitted_;
  release_slot(client);
  if (!comes_again_in) return;
  std::erase_if(reservations_,
                [&](const Reservation& reservation) { return reservation.client == client; });
  // Who comes at once finds one that is free; and of connections that ask once and go, none is
  // kept.
  if (*comes_again_in == 0 && free_slots() > reservations_.size() + 1) return;
  if (reservations_.size() >= kMaxClients) return;
  reservations_.push_front({client, after(kGraceFactor * *comes_again_in + kAtOnceSeconds)});
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
    for (const Waiting& waiting : dropped) release_slot(waiting.client);
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
  for (const Waiting& waiting : dropped) waiting.job.drop();
}

void JobQueue::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
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

size_t JobQueue::free_slots() const {
  const size_t slots = capacity_ + thread_count_;
  return slots - std::min(slots, waiting_.size() + running_ + admitted_);
}

// Who has a reservation before `end`, and holds not much already: who does is not before a client
// that holds little, whoever asked first.
size_t JobQueue::clients_ahead(const QueueClient& client,
                               const Reservations::const_iterator& end) const {
  std::set<std::string_view> others;
  size_t ahead = 0;
  for (auto reservation = reservations_.begin(); reservation != end; ++reservation) {
    if (has_more(reservation->client, client, kMargin)) continue;
    if (reservation->client.who == client.who || others.insert(reservation->client.who).second)
      ++ahead;
  }
  return ahead;
}

// Among all, or its connection among those of the same client.
bool JobQueue::has_its_share(const QueueClient& client) const {
  const auto held = held_.find(client.who);
  if (held == held_.end()) return false;
  // `name` holds so many slots beside others, who are there, were served lately or are to come
  // again: who asks for one thing after the other comes again soon.
  const auto is_full = [this](size_t slots, size_t holders, const auto& starts,
                              const std::string& name, const auto& is_another) {
    return slots >= std::max(kMargin, free_slots()) &&
           (holders > 1 || std::ranges::any_of(reservations_, is_another) ||
            std::ranges::any_of(starts, [&](const auto& start) {
              return start.first != name && start.second + 2 * thread_count_ > started_;
            }));
  };
  const auto& connections = held->second.connections;
  const auto own = connections.find(client.connection);
  return is_full(held->second.all, held_.size(), last_start_, client.who,
                 [&](const Reservation& r) { return r.client.who != client.who; }) ||
         is_full(own == connections.end() ? 0 : own->second, connections.size(),
                 last_start_of_connection_, client.connection, [&](const Reservation& r) {
                   return r.client.who == client.who && r.client.connection != client.connection;
                 });
}

double JobQueue::seconds_of_ends(double ends) const {
  // Before a job has ended nobody knows: who asks again soon will be told better.
  if (!seconds_per_job_) return kFirstGuessSeconds;
  return std::clamp(ends * *seconds_per_job_ / static_cast<double>(thread_count_), kMinRetrySeconds,
                    kMaxRetrySeconds);
}

void JobQueue::drop_expired_reservations() {
  const auto now = Clock::now();
  std::erase_if(reservations_,
                [&](const Reservation& reservation) { return reservation.until < now; });
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
  const auto record_start = [this](auto& starts, const std::string& name) {
    starts[name] = started_;
    // Whoever was served longest ago is new again.
    if (starts.size() > kMaxClients) {
      starts.erase(
          std::ranges::min_element(starts, {}, [](const auto& start) { return start.second; }));
    }
  };
  record_start(last_start_, taken.client.who);
  record_start(last_start_of_connection_, taken.client.connection);
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
    if (!dropped) {
      const double before = seconds_per_job_.value_or(took.count());
      seconds_per_job_ = before + kRecency * (took.count() - before);
    }
    --running_;
    release_slot(next.client);
    if (waiting_.empty() && running_ == 0) idle_.notify_all();
  }
}

}  // namespace itn
