#include "client/render_pool/render_pool.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <thread>
#include <utility>

#include "common/error.h"
#include "common/rpc/channel.h"
#include "common/rpc/status.h"
#include "itn/v1/render.grpc.pb.h"
#include "server/render/render_reply.h"
#include "server/render/render_server.h"

namespace itn {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// Two jobs on their way to each worker: one is rendered, the next waits in the worker's queue.
constexpr int kJobsPerWorker = 2;

// A worker that failed rests this long, twice as long after each further failure, up to the
// maximum.
constexpr milliseconds kFirstRest{200};
constexpr milliseconds kLongestRest{2000};

// Of the call that asks a worker whether it is there.
constexpr milliseconds kProbeDeadline{2000};

// A job that runs into its deadline again and again is too large, not unlucky.
constexpr int kMaxTimeouts = 3;

// Parts of a split render have at least this many samples, about a second of work, and there are at
// most so many parts.
constexpr uint64_t kSamplesPerPart = uint64_t{1} << 20;
constexpr uint64_t kMaxParts = 1024;

double in_seconds(milliseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

// A failure that another worker, or the same one later, may not have.
bool may_retry(const grpc::Status& status) {
  return to_error(status, "").kind() == ErrorKind::kUnavailable;
}

bool asks_for_scene(const grpc::Status& status, const std::string& digest) {
  v1::SceneNotHeld details;
  return status.error_code() == grpc::StatusCode::FAILED_PRECONDITION &&
         details.ParseFromString(status.error_details()) && details.scene_digest() == digest;
}

std::string describe(const grpc::Status& status) {
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) return "it is not a render worker";
  return status.error_message();
}

struct Task {
  RenderJob job;
  std::promise<v1::RenderGradReply> promise;
  int attempts = 0;
  int timeouts = 0;
};

struct Worker {
  Worker(std::string worker_name, const std::shared_ptr<grpc::Channel>& channel)
      : name(std::move(worker_name)), stub(v1::RenderService::NewStub(channel)) {}

  const std::string name;
  const std::unique_ptr<v1::RenderService::Stub> stub;
  // Guarded by the pool's mutex.
  bool up = false;  // takes jobs; otherwise it is resting, or has not answered yet
  milliseconds rest{0};
  std::string last_failure = "no answer";
};

// Sample ranges of the parts of a split render.
std::vector<v1::SampleRange> split(const v1::RenderGradRequest& request, uint64_t pixels,
                                   int workers) {
  v1::SampleRange whole;
  whole.set_count(request.spp());
  if (request.has_sample_range()) whole = request.sample_range();
  // Each part needs at least as many samples as there are estimates.
  const uint64_t most =
      std::clamp<uint64_t>(whole.count() / std::max(request.estimates(), 1U), 1, kMaxParts);
  const uint64_t by_work = whole.count() * pixels / kSamplesPerPart;
  const uint64_t parts = std::clamp<uint64_t>(by_work, std::min<uint64_t>(workers, most), most);
  std::vector<v1::SampleRange> ranges(parts);
  for (uint64_t i = 0; i < parts; ++i) {
    const uint64_t begin = whole.count() * i / parts;
    const uint64_t end = whole.count() * (i + 1) / parts;
    ranges[i].set_first(static_cast<uint32_t>(whole.first() + begin));
    ranges[i].set_count(static_cast<uint32_t>(end - begin));
  }
  return ranges;
}

uint64_t pixel_count(const SerializedScene& scene) {
  v1::Scene proto;
  if (!proto.ParseFromString(scene.bytes)) throw invalid_input("not a serialized itn.v1.Scene");
  return uint64_t{proto.film().width()} * proto.film().height();
}

}  // namespace

class RenderPool::Impl {
 public:
  explicit Impl(RenderPoolOptions options) : options_(std::move(options)) {
    if (options_.workers.empty()) {
      embedded_ = std::make_unique<RenderServer>(embedded_options());
      workers_.push_back(
          std::make_unique<Worker>("the embedded worker", embedded_->in_process_channel()));
    }
    for (const std::string& address : options_.workers) {
      workers_.push_back(std::make_unique<Worker>("worker " + address, connect_to(address)));
    }
    for (const auto& worker : workers_) {
      threads_.emplace_back([this, &w = *worker] {
        bring_up(w);
        serve(w);
      });
      for (int i = 1; i < kJobsPerWorker; ++i) {
        threads_.emplace_back([this, &w = *worker] { serve(w); });
      }
    }
    wait_for_first_worker();
  }

  ~Impl() { stop(); }

  std::future<v1::RenderGradReply> submit(RenderJob job) {
    auto task = std::make_unique<Task>();
    task->job = std::move(job);
    auto future = task->promise.get_future();
    {
      const std::lock_guard lock(mutex_);
      if (waiting_.empty()) failing_since_.reset();  // failures while there was nothing to do
      waiting_.push_back(std::move(task));
    }
    changed_.notify_all();
    return future;
  }

  int parallelism() const { return static_cast<int>(workers_.size()) * kJobsPerWorker; }

  int workers() const { return static_cast<int>(workers_.size()); }

  Statistics statistics() const {
    const std::lock_guard lock(mutex_);
    return statistics_;
  }

 private:
  RenderServerOptions embedded_options() const {
    RenderServerOptions options;
    options.reflection = false;
    options.service.threads = options_.embedded_threads;
    return options;
  }

  void wait_for_first_worker() {
    std::unique_lock lock(mutex_);
    if (changed_.wait_for(lock, options_.connect_within, [this] { return any_up(); })) return;
    lock.unlock();
    const std::string failures = last_failures();  // before stop() adds its own
    stop();
    throw Error(ErrorKind::kUnavailable, "no render worker answers (" + failures + ")");
  }

  // Requires the lock.
  bool any_up() const {
    return std::any_of(workers_.begin(), workers_.end(), [](const auto& w) { return w->up; });
  }

  // Takes jobs as long as the worker is up.
  void serve(Worker& worker) {
    while (std::unique_ptr<Task> task = next_task(worker)) {
      ++task->attempts;
      v1::RenderGradReply reply;
      const grpc::Status status = attempt(worker, task->job, reply);
      if (status.ok()) {
        succeed(worker, *task, std::move(reply));
      } else if (may_retry(status)) {
        retry(worker, std::move(task), status);
      } else {
        const std::string who = embedded_ ? "" : worker.name;
        task->promise.set_exception(std::make_exception_ptr(to_error(status, who)));
      }
    }
  }

  // Null when the pool stops.
  std::unique_ptr<Task> next_task(const Worker& worker) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return stopping() || (worker.up && !waiting_.empty()); });
    if (stopping()) return nullptr;
    auto task = std::move(waiting_.front());
    waiting_.pop_front();
    if (task->attempts > 0) ++statistics_.retries;
    return task;
  }

  // The scene travels only to a worker that says that it does not hold it.
  grpc::Status attempt(Worker& worker, const RenderJob& job, v1::RenderGradReply& reply) {
    v1::RenderGradRequest request = job.request;
    request.set_scene_digest(job.scene->digest);
    grpc::Status status = call(worker, request, reply);
    if (asks_for_scene(status, job.scene->digest)) {
      count_scene_sent();
      request.set_scene(job.scene->bytes);
      status = call(worker, request, reply);
    }
    if (!status.ok()) return status;
    try {
      check_reply(reply, job.request);
    } catch (const Error& error) {
      return to_status(error);
    }
    return status;
  }

  grpc::Status call(Worker& worker, const v1::RenderGradRequest& request,
                    v1::RenderGradReply& reply) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + options_.deadline);
    const std::stop_callback cancel(stop_.get_token(), [&] { context.TryCancel(); });
    reply.Clear();
    return worker.stub->RenderGrad(&context, request, &reply);
  }

  void succeed(Worker& worker, Task& task, v1::RenderGradReply reply) {
    {
      const std::lock_guard lock(mutex_);
      ++statistics_.jobs;
      statistics_.cpu_seconds += reply.counters().cpu_seconds();
      failing_since_.reset();
      worker.rest = kFirstRest;
    }
    task.promise.set_value(std::move(reply));
  }

  // Puts the task back at the front, for whichever worker is free, and lets this one rest.
  void retry(Worker& worker, std::unique_ptr<Task> task, const grpc::Status& status) {
    spdlog::warn("{}: {}; the render goes to the next free worker", worker.name, describe(status));
    if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED &&
        ++task->timeouts == kMaxTimeouts) {
      fail(*task, fmt::format("a render took longer than {} s in each of {} attempts",
                              in_seconds(options_.deadline), kMaxTimeouts));
      task.reset();
    }
    bool was_up = false;
    {
      const std::lock_guard lock(mutex_);
      was_up = std::exchange(worker.up, false);
      if (task) waiting_.push_front(std::move(task));
      note_failure(worker, status);
    }
    give_up_if_failing_for_long();
    changed_.notify_all();
    if (was_up) bring_up(worker);
  }

  // Rests and asks until the worker answers; meanwhile, its other threads wait.
  void bring_up(Worker& worker) {
    bool patient = false;  // impatient at first: that tells why there is no connection
    while (!stopping()) {
      rest(worker);
      grpc::Status status;
      do {
        status = probe(worker, std::exchange(patient, true));
        note_probe(worker, status);
        give_up_if_failing_for_long();
      } while (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED && !stopping());
      if (status.ok()) return;
    }
  }

  void note_probe(Worker& worker, const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    if (!status.ok()) return note_failure(worker, status);
    worker.up = true;
    changed_.notify_all();
  }

  // Requires the lock.
  void note_failure(Worker& worker, const grpc::Status& status) {
    // That it took too long says less than what was noted before.
    if (status.error_code() != grpc::StatusCode::DEADLINE_EXCEEDED) {
      worker.last_failure = describe(status);
    }
    if (!any_up() && !failing_since_) failing_since_ = Clock::now();
  }

  // A worker that is up will get to the jobs that wait. One that answers but fails every job is not
  // up while it rests, which is when this is called.
  void give_up_if_failing_for_long() {
    std::deque<std::unique_ptr<Task>> given_up;
    {
      const std::lock_guard lock(mutex_);
      if (any_up() || !failing_since_) return;
      if (Clock::now() - *failing_since_ < options_.give_up_after) return;
      given_up.swap(waiting_);
    }
    for (const auto& task : given_up) {
      fail(*task, fmt::format("no render worker has answered for {} s ({})",
                              in_seconds(options_.give_up_after), last_failures()));
    }
  }

  std::string last_failures() const {
    const std::lock_guard lock(mutex_);
    std::string failures;
    for (const auto& worker : workers_) {
      failures +=
          fmt::format("{}{}: {}", failures.empty() ? "" : "; ", worker->name, worker->last_failure);
    }
    return failures;
  }

  void rest(Worker& worker) {
    std::unique_lock lock(mutex_);
    const milliseconds duration = worker.rest;
    worker.rest = std::clamp(2 * duration, kFirstRest, kLongestRest);
    changed_.wait_for(lock, duration, [this] { return stopping(); });
  }

  // Asks for anything. A patient call waits for a connection: gRPC 1.51 attends to a connection
  // that is being made only while a call waits for it.
  grpc::Status probe(Worker& worker, bool patient) {
    grpc::ClientContext context;
    context.set_wait_for_ready(patient);
    context.set_deadline(std::chrono::system_clock::now() + kProbeDeadline);
    const std::stop_callback cancel(stop_.get_token(), [&] { context.TryCancel(); });
    v1::Capabilities capabilities;
    return worker.stub->GetCapabilities(&context, v1::GetCapabilitiesRequest(), &capabilities);
  }

  static void fail(Task& task, const std::string& message) {
    task.promise.set_exception(std::make_exception_ptr(Error(ErrorKind::kUnavailable, message)));
  }

  bool stopping() const { return stop_.stop_requested(); }

  void stop() {
    stop_.request_stop();
    {
      // Whoever is about to wait for a change has seen the stop, or waits by now.
      const std::lock_guard lock(mutex_);
    }
    changed_.notify_all();
    threads_.clear();  // joins
    for (const auto& task : waiting_) {
      task->promise.set_exception(
          std::make_exception_ptr(Error(ErrorKind::kCancelled, "the render pool was closed")));
    }
    waiting_.clear();
  }

  void count_scene_sent() {
    const std::lock_guard lock(mutex_);
    ++statistics_.scenes_sent;
  }

  const RenderPoolOptions options_;
  std::unique_ptr<RenderServer> embedded_;
  std::vector<std::unique_ptr<Worker>> workers_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::unique_ptr<Task>> waiting_;
  Statistics statistics_;
  std::optional<Clock::time_point> failing_since_;  // no job has succeeded since
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
  std::vector<std::future<v1::RenderGradReply>> parts;
  for (const v1::SampleRange& range :
       split(job.request, pixel_count(*job.scene), impl_->workers())) {
    RenderJob part = job;
    *part.request.mutable_sample_range() = range;
    part.request.set_exact_sums(true);
    parts.push_back(submit(std::move(part)));
  }
  std::optional<tracer::FilmSums> sums;
  for (size_t i = 0; i < parts.size(); ++i) {
    while (parts[i].wait_for(milliseconds(100)) != std::future_status::ready) {
      if (progress) progress(static_cast<double>(i) / static_cast<double>(parts.size()));
    }
    tracer::FilmSums part = film_sums(parts[i].get());
    if (sums) {
      tracer::merge(*sums, part);
    } else {
      sums = std::move(part);
    }
  }
  if (progress) progress(1);
  return make_reply(*sums, job.request);
}

int RenderPool::parallelism() const {
  return impl_->parallelism();
}

RenderPool::Statistics RenderPool::statistics() const {
  return impl_->statistics();
}

}  // namespace itn
