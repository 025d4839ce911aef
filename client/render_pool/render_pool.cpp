#include "client/render_pool/render_pool.h"

#include <condition_variable>
#include <deque>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "client/render_pool/tiles.h"
#include "client/render_pool/worker_connection.h"
#include "common/error.h"
#include "common/rpc/channel.h"
#include "server/render/render_server.h"

namespace itn {
namespace {

using Clock = Dispatcher::Clock;
using std::chrono::milliseconds;

// Two jobs on their way to each worker: one is rendered, the next waits in the worker's queue.
constexpr int kJobsPerWorker = 2;

}  // namespace

// Threads that carry out what the dispatcher decides: kJobsPerWorker for each worker.
class RenderPool::Impl {
 public:
  explicit Impl(RenderPoolOptions options)
      : options_(std::move(options)), dispatcher_(names(), options_.give_up_after) {
    connect_all();
    for (size_t worker = 0; worker < connections_.size(); ++worker) {
      threads_.emplace_back([this, worker] {
        bring_up(worker);
        serve(worker);
      });
      for (int i = 1; i < kJobsPerWorker; ++i) {
        threads_.emplace_back([this, worker] { serve(worker); });
      }
    }
    wait_for_first_worker();
  }

  ~Impl() { stop(); }

  std::future<v1::RenderGradReply> submit(RenderJob job) {
    const auto notify = notifying();
    return dispatcher_.submit(std::move(job), Clock::now());
  }

  int workers() const { return static_cast<int>(connections_.size()); }

  Statistics statistics() const {
    const std::lock_guard lock(mutex_);
    return dispatcher_.statistics();
  }

 private:
  std::vector<std::string> names() const {
    if (options_.workers.empty()) return {""};
    std::vector<std::string> names;
    for (const std::string& address : options_.workers) names.push_back("worker " + address);
    return names;
  }

  void connect_all() {
    if (options_.workers.empty()) {
      RenderServerOptions options;
      options.reflection = false;
      options.service.threads = options_.embedded_threads;
      options.service.cache_bytes = options_.embedded_cache_bytes;
      embedded_ = std::make_unique<RenderServer>(options);
      connections_.push_back(std::make_unique<WorkerConnection>(embedded_->in_process_channel()));
      return;
    }
    const Connector connector(options_.security);
    for (const std::string& address : options_.workers) {
      connections_.push_back(std::make_unique<WorkerConnection>(
          connector.connect_to(address), [connector, address](const grpc::Status& status) {
            return connector.explained(status, address);
          }));
    }
  }

  void wait_for_first_worker() {
    std::unique_lock lock(mutex_);
    const bool up =
        changed_.wait_for(lock, options_.connect_within, [this] { return dispatcher_.any_up(); });
    if (up) return;
    const std::string failures = dispatcher_.last_failures();  // before stop() adds its own
    lock.unlock();
    stop();
    throw Error(ErrorKind::kUnavailable, "no render worker answers (" + failures + ")");
  }

  // One attempt after the other.
  void serve(size_t worker) {
    while (const std::shared_ptr<Dispatcher::Attempt> attempt = next(worker)) {
      Answer answer = carry_out(*attempt);
      bool look_after = false;
      {
        const auto notify = notifying();
        look_after = dispatcher_.finish(attempt, std::move(answer), Clock::now());
      }
      if (look_after) bring_up(worker);
    }
  }

  // Null when the pool stops.
  std::shared_ptr<Dispatcher::Attempt> next(size_t worker) {
    std::unique_lock lock(mutex_);
    while (!stopping()) {
      const Dispatcher::Turn turn = dispatcher_.next(worker, Clock::now());
      if (turn.attempt) {
        changed_.notify_all();  // an idle worker counts the time from now
        return turn.attempt;
      }
      if (turn.until == Clock::time_point::max()) {
        changed_.wait(lock);
      } else {
        changed_.wait_until(lock, turn.until);
      }
    }
    return nullptr;
  }

  Answer carry_out(const Dispatcher::Attempt& attempt) {
    WorkerConnection& connection = *connections_[attempt.worker];
    const std::stop_token stop = attempt.stop.get_token();
    if (attempt.suspect) {
      v1::Capabilities ignored;
      const grpc::Status status = connection.probe(false, stop, ignored);
      if (!status.ok()) return {.outcome = Outcome::kAway, .status = status, .reply = {}};
    }
    return connection.render(attempt.render(), options_.deadline, stop);
  }

  // Rests and asks until the worker answers; meanwhile, its other threads wait.
  void bring_up(size_t worker) {
    bool patient = false;  // impatient at first: that tells why there is no connection
    while (!stopping()) {
      rest(worker);
      grpc::Status status;
      do {
        v1::Capabilities capabilities;
        status = connections_[worker]->probe(std::exchange(patient, true), stop_.get_token(),
                                             capabilities);
        const auto notify = notifying();
        if (!stopping()) dispatcher_.probed(worker, status, capabilities, Clock::now());
      } while (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED && !stopping());
      if (status.ok()) return;
    }
  }

  void rest(size_t worker) {
    std::unique_lock lock(mutex_);
    const auto until = Clock::now() + dispatcher_.take_rest(worker);
    changed_.wait_until(lock, until, [this] { return stopping(); });
  }

  bool stopping() const { return stop_.stop_requested(); }

  void stop() {
    stop_.request_stop();
    {
      const auto notify = notifying();
      dispatcher_.close();
    }
    threads_.clear();  // joins
  }

  // Holds the lock; at its end, all threads look at what has changed.
  class Notifying {
   public:
    explicit Notifying(Impl& pool) : pool_(pool), lock_(pool.mutex_) {}
    ~Notifying() { pool_.changed_.notify_all(); }
    Notifying(const Notifying&) = delete;
    Notifying& operator=(const Notifying&) = delete;

   private:
    Impl& pool_;
    std::lock_guard<std::mutex> lock_;
  };
  Notifying notifying() { return Notifying(*this); }

  const RenderPoolOptions options_;
  std::unique_ptr<RenderServer> embedded_;
  std::vector<std::unique_ptr<WorkerConnection>> connections_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Dispatcher dispatcher_;  // guarded by the mutex
  std::stop_source stop_;

  std::vector<std::jthread> threads_;  // last: they use what is above
};

RenderPool::RenderPool(RenderPoolOptions options)
    : impl_(std::make_unique<Impl>(std::move(options))) {}

RenderPool::~RenderPool() = default;

std::future<v1::RenderGradReply> RenderPool::submit(RenderJob job) {
  return impl_->submit(std::move(job));
}

v1::RenderGradReply RenderPool::render_split(const RenderJob& job, const Progress& progress) {
  const v1::Tile whole = pixels_of(job);
  const std::vector<v1::Tile> tiles = tiles_of(whole, job.request.spp());
  // Enough for all workers, and not many that have been answered and wait for an earlier one.
  const size_t ahead = 2 * static_cast<size_t>(parallelism()) + 1;
  TiledReply reply(whole);
  std::deque<std::future<v1::RenderGradReply>> pending;
  for (size_t next = 0, done = 0; done < tiles.size(); ++done) {
    for (; next < tiles.size() && pending.size() < ahead; ++next) {
      RenderJob part = job;
      *part.request.mutable_tile() = tiles[next];
      pending.push_back(submit(std::move(part)));
    }
    do {
      if (progress) progress(static_cast<double>(done) / static_cast<double>(tiles.size()));
    } while (pending.front().wait_for(milliseconds(100)) != std::future_status::ready);
    reply.add(tiles[done], pending.front().get());
    pending.pop_front();
  }
  if (progress) progress(1);
  return reply.take();
}

int RenderPool::parallelism() const {
  return impl_->workers() * kJobsPerWorker;
}

RenderPool::Statistics RenderPool::statistics() const {
  return impl_->statistics();
}

}  // namespace itn
