#include "client/render_pool/render_pool.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <thread>
#include <utility>

#include "client/render_pool/dispatcher.h"
#include "client/render_pool/render_worker.h"
#include "client/render_pool/worker_connection.h"
#include "client/render_pool/worker_list.h"
#include "client/rpc/channel.h"
#include "common/error.h"
#include "server/render/render_server.h"

namespace itn {
namespace {

using Clock = Dispatcher::Clock;
using std::chrono::milliseconds;
using std::chrono::seconds;

// Two jobs on their way to each worker: one is rendered, the next waits in the worker's queue.
constexpr int kJobsPerWorker = 2;

// No render is late sooner (RenderTimes): looking for late ones this often misses none.
constexpr milliseconds kLookForLateEvery{100};

// That there is no worker to wait for is said this often.
constexpr seconds kSayAgain{60};

// One worker, and the threads that ask it. Guarded by the pool's mutex, but for the connection.
struct Member {
  size_t number = 0;  // of the dispatcher
  std::string address;
  std::unique_ptr<RenderWorker> connection;
  std::stop_source stop;             // it has left, or the pool stops
  std::condition_variable woken_up;  // of parked threads
  std::condition_variable released;  // of one that rests
  uint64_t turn = 0;                 // the later it was parked, the higher; no two have the same
  int parked = 0;                    // threads that wait for something to do
  int woken = 0;                     // of those that waited, on their way to see what there is
  int running = 0;
  std::vector<std::jthread> threads;

  bool stopping() const { return stop.stop_requested(); }
};

// The emptiest first: a job that two could take is the idle one's. Of several, the one that has
// waited longest, so that all are used.
struct EmptiestFirst {
  bool operator()(const Member* a, const Member* b) const {
    return std::pair(-a->parked, a->turn) < std::pair(-b->parked, b->turn);
  }
};

}  // namespace

// Threads that carry out what the dispatcher decides: kJobsPerWorker for each worker. Those for
// whom there is nothing are parked, and woken one by one, so that what an event costs does not grow
// with the number of workers.
class RenderPool::Impl {
 public:
  explicit Impl(RenderPoolOptions options)
      : options_(std::move(options)), dispatcher_(options_.give_up_after), list_(options_.workers) {
    try {
      if (options_.workers.empty()) {
        update({WorkerList::Address("")});
      } else {
        connector_ = std::make_shared<Connector>(options_.security);
        list_.watch([this](const WorkerList::Addresses& addresses) { update(addresses); });
      }
      timekeeper_ = std::jthread([this] { keep_time(); });
      wait_for_first_worker();
    } catch (...) {
      stop();  // nobody else does, of what has not come to be
      throw;
    }
  }

  ~Impl() { stop(); }

  std::future<v1::RenderGradReply> submit(RenderJob job) {
    const std::lock_guard lock(mutex_);
    auto future = dispatcher_.submit(std::move(job), Clock::now());
    wake_parked();
    return future;
  }

  int workers() const {
    const std::lock_guard lock(mutex_);
    return std::max(static_cast<int>(members_.size()), 1);
  }

  RenderStatistics statistics() const {
    const std::lock_guard lock(mutex_);
    return dispatcher_.statistics();
  }

 private:
  // ---- Workers that join and leave ----

  // Throws Error as Connector::connect_to for the last address that it does for; all others have
  // joined then.
  void update(const WorkerList::Addresses& addresses) {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    std::erase_if(left_, [](const auto& member) { return member->running == 0; });
    for (auto member = members_.begin(); member != members_.end();) {
      const auto next = std::next(member);
      const bool stays = std::ranges::find(addresses, member->first,
                                           &WorkerList::Address::address) != addresses.end();
      if (!stays) leave(member);
      member = next;
    }
    std::optional<Error> mistake;
    for (const WorkerList::Address& worker : addresses) {
      if (members_.contains(worker.address)) continue;
      try {
        join(worker);
      } catch (const Error& error) {
        mistake = error;
      }
    }
    wake_parked();
    if (mistake) throw *mistake;
  }

  void join(const WorkerList::Address& worker) {
    const std::string& address = worker.address;
    auto member = std::make_unique<Member>();
    member->connection = connect(worker);
    if (said_who_is_there_) spdlog::info("worker {} joins", address);
    member->number = dispatcher_.add(address.empty() ? "" : "worker " + address);
    member->address = address;
    member->running = kJobsPerWorker;
    Member& joined = *members_.emplace(address, std::move(member)).first->second;
    for (int i = 0; i < kJobsPerWorker; ++i) {
      joined.threads.emplace_back([this, &joined, first = i == 0] {
        if (first) reconnect(joined);
        serve(joined);
        const std::lock_guard lock(mutex_);
        --joined.running;
      });
    }
  }

  // Its threads end when what they have under way does.
  void leave(std::map<std::string, std::unique_ptr<Member>>::iterator member) {
    spdlog::info("worker {} is not on the list any more", member->first);
    dispatcher_.remove(member->second->number, Clock::now());
    release(*member->second);
    left_.push_back(std::move(member->second));
    members_.erase(member);
  }

  void release(Member& member) {
    member.stop.request_stop();
    member.woken_up.notify_all();
    member.released.notify_all();
  }

  std::unique_ptr<RenderWorker> connect(const WorkerList::Address& worker) {
    if (options_.connect) return options_.connect(worker.address);
    if (!worker.address.empty()) {
      const std::shared_ptr<const Connector> connector = connector_to(worker.name);
      return std::make_unique<WorkerConnection>(
          connector->connect_to(worker.address),
          [connector, address = worker.address](const grpc::Status& status) {
            return connector->with_cause(status, address);
          });
    }
    RenderServerOptions options;
    options.service.threads = options_.embedded_threads;
    options.service.cache_bytes = options_.embedded_cache_bytes;
    embedded_ = std::make_unique<RenderServer>(options);
    return std::make_unique<WorkerConnection>(embedded_->in_process_channel());
  }

  // To workers that were found by this name, which their certificates say then.
  std::shared_ptr<const Connector> connector_to(const std::string& name) {
    ClientSecurity security = options_.security;
    if (!security.encrypts() || !security.server_name.empty() || name.empty()) return connector_;
    security.server_name = name;
    std::shared_ptr<const Connector>& connector = named_connectors_[name];
    if (!connector) connector = std::make_shared<Connector>(security);
    return connector;
  }

  void wait_for_first_worker() {
    std::unique_lock lock(mutex_);
    probed_.wait_for(lock, options_.connect_within,
                     [this] { return dispatcher_.any_connected() || dispatcher_.all_refuse(); });
    said_who_is_there_ = true;
    if (dispatcher_.any_connected() || !dispatcher_.has_workers()) return;
    throw Error(ErrorKind::kUnavailable,
                "no render worker answers (" + dispatcher_.last_failures() + ")");
  }

  // ---- The threads of a worker ----

  // One attempt after the other, for each of which the lock is taken once: it is what many workers
  // contend for.
  void serve(Member& member) {
    std::shared_ptr<Dispatcher::Attempt> attempt, done;
    std::unique_lock lock(mutex_);
    while ((attempt = next(member, lock))) {
      lock.unlock();
      done = attempt;  // and what was done before is let go without the lock
      Answer answer = carry_out(member, *attempt);
      lock.lock();
      const bool look_after = dispatcher_.finish(attempt, std::move(answer), Clock::now());
      wake_parked();
      if (!look_after) continue;
      lock.unlock();
      list_.refresh();
      reconnect(member);
      lock.lock();
    }
  }

  // Null when the worker has left, or the pool stops.
  std::shared_ptr<Dispatcher::Attempt> next(Member& member, std::unique_lock<std::mutex>& lock) {
    while (!member.stopping()) {
      const Dispatcher::Turn turn = dispatcher_.next(member.number, Clock::now());
      if (turn.attempt) return turn.attempt;
      idle(member, lock, turn.until);
    }
    return nullptr;
  }

  Answer carry_out(Member& member, const Dispatcher::Attempt& attempt) {
    const std::stop_token stop = attempt.stop.get_token();
    if (attempt.suspect) {
      v1::Capabilities ignored;
      const grpc::Status status = member.connection->probe(false, stop, ignored);
      if (!status.ok()) return {.outcome = Outcome::kUnreachable, .status = status, .reply = {}};
    }
    milliseconds deadline = options_.deadline;
    if (attempt.deadline > milliseconds(0)) deadline = std::min(deadline, attempt.deadline);
    return member.connection->render(attempt.render(), deadline, stop);
  }

  // Rests and asks until the worker answers; meanwhile, its other threads wait.
  void reconnect(Member& member) {
    bool patient = false;  // impatient at first: that tells why there is no connection
    grpc::Status status;
    do {
      probe_delay(member);
      do {
        v1::Capabilities capabilities;
        status = member.connection->probe(std::exchange(patient, true), member.stop.get_token(),
                                          capabilities);
        const std::lock_guard lock(mutex_);
        if (member.stopping()) return;
        dispatcher_.on_probe(member.number, status, capabilities, Clock::now());
        probed_.notify_all();
        wake_parked();
      } while (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED);
    } while (!status.ok());
  }

  void probe_delay(Member& member) {
    std::unique_lock lock(mutex_);
    if (member.stopping()) return;
    const auto until = Clock::now() + dispatcher_.next_probe_delay(member.number);
    member.released.wait_until(lock, until, [&] { return member.stopping(); });
  }

  // ---- Threads that wait for something to do ----

  // Waits until the thread is woken, or until then.
  void idle(Member& member, std::unique_lock<std::mutex>& lock, Clock::time_point until) {
    count_parked(member, +1);
    wake_parked();  // whoever was woken for what this one may not take, has told nobody else
    const auto done = [&] { return member.woken > 0 || member.stopping(); };
    if (until == Clock::time_point::max()) {
      member.woken_up.wait(lock, done);
    } else {
      member.woken_up.wait_until(lock, until, done);
    }
    if (member.woken > 0) {
      --member.woken;
      --woken_;
    } else {
      count_parked(member, -1);
    }
  }

  void count_parked(Member& member, int more) {
    parked_.erase(&member);
    member.turn = next_turn_++;
    member.parked += more;
    if (member.parked > 0) parked_.insert(&member);
  }

  void wake(Member& member) {
    count_parked(member, -1);
    ++member.woken;
    ++woken_;
    member.woken_up.notify_one();
  }

  // Wakes as many as there are renders that wait and that nobody is on the way to.
  void wake_parked() {
    size_t open = dispatcher_.waiting() - std::min(dispatcher_.waiting(), woken_);
    for (auto it = parked_.begin(); open > 0 && it != parked_.end();) {
      Member& member = **it++;
      if (member.stopping() || !dispatcher_.has_render_for(member.number, Clock::now())) continue;
      wake(member);
      --open;
    }
  }

  // ---- What time brings ----

  void keep_time() {
    std::optional<Clock::time_point> said;
    std::unique_lock lock(mutex_);
    while (!stopping_) {
      const auto now = Clock::now();
      const Dispatcher::Stragglers stragglers = dispatcher_.stragglers(now);
      wake_idle(stragglers.count);
      if (dispatcher_.has_workers()) {
        said.reset();
      } else if (dispatcher_.waiting() > 0 && (!said || now - *said > kSayAgain)) {
        said = now;
        lock.unlock();
        spdlog::warn("there are no render workers; waiting for addresses from {}",
                     list_.unresolved());
        lock.lock();
        continue;
      }
      stopped_.wait_until(lock, std::min(stragglers.next, now + kLookForLateEvery));
    }
  }

  // For renders that are late.
  void wake_idle(size_t most) {
    for (auto it = parked_.begin(); most > 0 && it != parked_.end(); --most) {
      Member& member = **it++;
      if (member.parked < kJobsPerWorker) return;
      wake(member);
    }
  }

  void stop() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
      dispatcher_.close();
      for (const auto& [address, member] : members_) release(*member);
      stopped_.notify_all();
    }
    // Without the lock, which the threads want for a last time. No member joins or leaves any more.
    for (const auto& [address, member] : members_) member->threads.clear();
    for (const auto& member : left_) member->threads.clear();
    if (timekeeper_.joinable()) timekeeper_.join();
  }

  const RenderPoolOptions options_;
  std::shared_ptr<const Connector> connector_;  // null without workers
  std::map<std::string, std::shared_ptr<const Connector>> named_connectors_;
  std::unique_ptr<RenderServer> embedded_;

  mutable std::mutex mutex_;  // guards what follows
  Dispatcher dispatcher_;
  std::map<std::string, std::unique_ptr<Member>> members_;  // by address
  std::vector<std::unique_ptr<Member>> left_;
  std::set<Member*, EmptiestFirst> parked_;  // that have a parked thread
  uint64_t next_turn_ = 0;
  size_t woken_ = 0;  // of all members
  bool said_who_is_there_ = false;
  bool stopping_ = false;
  std::condition_variable probed_, stopped_;

  std::jthread timekeeper_;
  WorkerList list_;  // Last: its threads use what is above. Never called with the lock held, as it
                     // takes the lock within its own.
};

RenderPool::RenderPool(RenderPoolOptions options)
    : impl_(std::make_unique<Impl>(std::move(options))) {}

RenderPool::~RenderPool() = default;

std::future<v1::RenderGradReply> RenderPool::submit(RenderJob job) {
  return impl_->submit(std::move(job));
}

int RenderPool::parallelism() const {
  return impl_->workers() * kJobsPerWorker;
}

RenderStatistics RenderPool::statistics() const {
  return impl_->statistics();
}

}  // namespace itn
