#include "client/render_pool/dispatcher.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "client/render/tiles.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = Dispatcher::Clock;

// A worker that failed rests this long, twice as long after each further failure, up to the
// maximum. The same for one that has no place and does not say when to come back.
constexpr milliseconds kFirstRest{200};
constexpr milliseconds kLongestRest{2000};

// No worker sends us away for longer.
constexpr milliseconds kLongestWaitForPlace{30000};

// That the user waits for a place is said this often.
constexpr seconds kWaitNoticeInterval{60};

// That a render is late, if it has taken this long; and that a worker was never there.
constexpr seconds kWorthSaying{5};

// Losses of one render within this time may have one cause.
constexpr seconds kTogether{5};

double in_seconds(Clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

// What the worker says about itself; unknown limits are 0.
bool fits(const v1::Capabilities& worker, const RenderJob& job) {
  const auto within = [](uint64_t value, uint64_t most) { return most == 0 || value <= most; };
  return within(uint64_t{job.scene->width} * job.scene->height, worker.max_pixels()) &&
         within(job.request.spp(), worker.max_spp()) &&
         within(job.scene->triangles, worker.max_triangles()) &&
         within(job.scene->bytes.size() + job.request.ByteSizeLong(), worker.max_message_bytes());
}

// Paths that it traces, about: what its time grows with.
double samples(const RenderJob& job) {
  const v1::Tile tile = pixels_of(job);
  return static_cast<double>(tile.width()) * tile.height() * job.request.spp();
}

// Whether it is of another version (WorkerConnection::probe), or no render worker.
bool is_incompatible(const grpc::Status& status) {
  return status.error_code() == grpc::StatusCode::FAILED_PRECONDITION ||
         status.error_code() == grpc::StatusCode::UNIMPLEMENTED;
}

}  // namespace

struct Dispatcher::Job {
  struct Refusal {
    size_t worker;
    Error reason;
  };

  RenderJob render;
  std::promise<v1::RenderGradReply> promise;
  Clock::time_point submitted;
  bool ended = false;
  std::vector<std::shared_ptr<Attempt>> under_way;
  std::vector<Refusal> refusals;    // of workers that cannot do it
  std::vector<std::string> losses;  // under which a worker vanished
  Clock::time_point last_loss;

  bool refused_by(size_t worker) const {
    return std::ranges::any_of(refusals, [&](const Refusal& r) { return r.worker == worker; });
  }

  Error all_refusals() const {
    std::string text;
    for (const Refusal& refusal : refusals) {
      text += fmt::format("{}{}", text.empty() ? "" : "; ", refusal.reason.what());
    }
    return Error(refusals.front().reason.kind(), text);
  }
};

const RenderJob& Dispatcher::Attempt::render() const {
  return job->render;
}

// ---- Workers -----------------------------------------------------------------------------------

size_t Dispatcher::add(std::string name) {
  const size_t number = next_worker_++;
  workers_[number].name = std::move(name);
  return number;
}

void Dispatcher::remove(size_t number, Clock::time_point now) {
  const auto worker = workers_.find(number);
  worker->second.left = true;
  if (worker->second.under_way.empty()) workers_.erase(worker);
  fail_unservable(now);
}

// ---- Renders to workers ------------------------------------------------------------------------

std::future<v1::RenderGradReply> Dispatcher::submit(RenderJob render, Clock::time_point now) {
  auto job = std::make_shared<Job>();
  job->render = std::move(render);
  job->submitted = now;
  auto future = job->promise.get_future();
  if (const std::optional<Error> error = unservable(*job, now)) {
    fail(*job, *error);
  } else {
    waiting_.push_back(std::move(job));
  }
  return future;
}

Dispatcher::Turn Dispatcher::next(size_t number, Clock::time_point now) {
  const Worker& worker = workers_.at(number);
  if (!worker.connected || closed_) return {};
  if (now < worker.full_until) return {nullptr, worker.full_until};
  const auto job = first_for(number);
  if (job == waiting_.end()) return hedge(number, now);
  const std::shared_ptr<Job> taken = *job;
  waiting_.erase(job);
  return {begin(taken, number, now)};
}

bool Dispatcher::has_render_for(size_t number, Clock::time_point now) const {
  const Worker& worker = workers_.at(number);
  return worker.connected && now >= worker.full_until && first_for(number) != waiting_.end();
}

Dispatcher::Waiting::const_iterator Dispatcher::first_for(size_t number) const {
  return std::ranges::find_if(waiting_, [&](const auto& job) { return may_take(number, *job); });
}

// A render for which this worker is too small is left to one that is not, and is there; where none
// is known, the worker's own words say best why it cannot be done.
bool Dispatcher::may_take(size_t number, const Job& job) const {
  if (job.refused_by(number)) return false;
  if (fits(workers_.at(number).capabilities, job.render)) return true;
  for (const auto& [i, other] : workers_) {
    if (!other.excluded && !other.left && (other.connected || !other.failing_since) &&
        !job.refused_by(i) && fits(other.capabilities, job.render)) {
      return false;
    }
  }
  return true;
}

namespace {

bool has_one_attempt(const Dispatcher::Job& job) {
  return !job.ended && job.under_way.size() == 1;
}

}  // namespace

Dispatcher::Stragglers Dispatcher::stragglers(Clock::time_point now) const {
  Stragglers stragglers;
  for (const auto& [number, attempt] : under_way_) {
    if (!has_one_attempt(*attempt->job)) continue;
    stragglers.next = attempt->started + times_.straggler_after();
    if (stragglers.next > now) return stragglers;
    ++stragglers.count;
  }
  stragglers.next = Clock::time_point::max();
  return stragglers;
}

// Asks once more for the render that began first of those that are late.
Dispatcher::Turn Dispatcher::hedge(size_t number, Clock::time_point now) {
  const Worker& worker = workers_.at(number);
  if (!worker.under_way.empty()) return {};
  const auto stragglers = std::ranges::find_if(under_way_, [&](const auto& entry) {
    const Attempt& attempt = *entry.second;
    return attempt.started + times_.straggler_after() > now ||
           (has_one_attempt(*attempt.job) && may_take(number, *attempt.job));
  });
  if (stragglers == under_way_.end()) return {};
  const Attempt& attempt = *stragglers->second;
  const Clock::duration taken = now - attempt.started;
  if (taken < times_.straggler_after()) return {};  // and so are all that began later
  spdlog::log(taken < kWorthSaying ? spdlog::level::debug : spdlog::level::info,
              "{}: a render has taken {:.1f} s; {} renders it, too",
              label(workers_.at(attempt.worker)), in_seconds(taken), label(worker));
  ++statistics_.hedges;
  return {begin(attempt.job, number, now)};
}

std::shared_ptr<Dispatcher::Attempt> Dispatcher::begin(const std::shared_ptr<Job>& job,
                                                       size_t worker, Clock::time_point now) {
  auto attempt = std::make_shared<Attempt>();
  attempt->job = job;
  attempt->worker = worker;
  attempt->started = now;
  attempt->suspect = !job->losses.empty();
  std::deque<std::shared_ptr<Attempt>>& under_way = workers_.at(worker).under_way;
  // After a loss, nothing shorter than the user's own deadline: that may have been too short. Until
  // those before it are rendered, it waits.
  if (job->losses.empty()) {
    double all = samples(job->render);
    for (const auto& before : under_way) all += samples(before->render());
    attempt->deadline = times_.deadline(all);
  }
  attempt->number = next_attempt_++;
  under_way.push_back(attempt);
  job->under_way.push_back(attempt);
  under_way_.emplace(attempt->number, attempt);
  return attempt;
}

// ---- What becomes of them ----------------------------------------------------------------------

bool Dispatcher::finish(const std::shared_ptr<Attempt>& attempt, Answer answer,
                        Clock::time_point now) {
  const bool look_after = on_outcome(attempt, std::move(answer), now);
  const auto worker = workers_.find(attempt->worker);
  if (!worker->second.left) return look_after;
  if (worker->second.under_way.empty()) workers_.erase(worker);
  return false;
}

bool Dispatcher::on_outcome(const std::shared_ptr<Attempt>& attempt, Answer answer,
                            Clock::time_point now) {
  Worker& worker = workers_.at(attempt->worker);
  const std::shared_ptr<Job> job = attempt->job;
  // Workers render in the order in which they are asked, as far as is known here: those behind the
  // first are lost with it, whichever of them is heard of first.
  if (answer.outcome == Outcome::kLost && worker.connected) {
    for (const auto& a : worker.under_way) a->only_waited = a != worker.under_way.front();
  }
  const bool was_rendered = worker.under_way.front() == attempt && !attempt->only_waited;
  std::erase(worker.under_way, attempt);
  std::erase(job->under_way, attempt);
  under_way_.erase(attempt->number);
  if (answer.scene_sent) ++statistics_.scenes_sent;
  if (answer.outcome == Outcome::kAnswered) {
    succeed(*attempt, std::move(answer.reply), now);
    return false;
  }
  if (attempt->stop.stop_requested()) {
    if (!job->ended) fail(*job, Error(ErrorKind::kCancelled, "the render pool was closed"));
    // It was late, and may be so with whatever it gets next: not at once.
    return std::exchange(worker.connected, false);
  }
  const std::string reason = describe(answer.status);
  bool look_after = false;
  switch (answer.outcome) {
    case Outcome::kAnswered: break;
    case Outcome::kBusy: wait_for_place(worker, answer.status, now); break;
    case Outcome::kInvalid: fail(*job, to_error(answer.status, worker.name)); break;
    case Outcome::kBadReply:
      exclude(worker, reason);
      job->refusals.push_back({attempt->worker, to_error(answer.status, worker.name)});
      break;
    case Outcome::kFailed:
      job->refusals.push_back({attempt->worker, to_error(answer.status, worker.name)});
      // That a limit is exceeded says nothing against the worker.
      if (answer.status.error_code() != grpc::StatusCode::RESOURCE_EXHAUSTED) {
        look_after = take_down(worker, reason, now);
      }
      break;
    case Outcome::kLost:
      if (worker.connected) worker.only_lost = true;
      if (was_rendered) note_loss(*attempt, fmt::format("{}: {}", label(worker), reason), now);
      [[fallthrough]];
    case Outcome::kUnreachable: look_after = take_down(worker, reason, now); break;
  }
  const bool is_left = !job->ended && job->under_way.empty();
  if (is_left) waiting_.push_front(job);
  if (answer.outcome == Outcome::kBusy) return false;
  fail_unservable(now);
  if (is_left && !job->ended) {
    ++statistics_.retries;
    spdlog::warn("{}: {}; the render {}", label(worker), reason,
                 any_connected() ? "goes to the next free worker"
                                 : fmt::format("waits for a worker, for {} s at most",
                                               in_seconds(give_up_after_)));
  }
  return look_after;
}

// Two attempts that were under way together and are lost together are one loss: of the network, or
// because this machine stood still.
void Dispatcher::note_loss(const Attempt& attempt, const std::string& what, Clock::time_point now) {
  Job& job = *attempt.job;
  const bool together =
      !job.losses.empty() && attempt.started < job.last_loss && now < job.last_loss + kTogether;
  job.last_loss = now;
  if (!together) job.losses.push_back(what);
}

void Dispatcher::succeed(const Attempt& attempt, v1::RenderGradReply reply, Clock::time_point now) {
  Worker& worker = workers_.at(attempt.worker);
  worker.failing_since.reset();
  worker.probe_delay = kFirstRest;
  worker.busy_delay = {};
  worker.full_until = {};          // what it has answered has left its place
  if (attempt.job->ended) return;  // the other attempt was a moment faster
  times_.add(now - attempt.started, samples(attempt.render()));
  ++statistics_.jobs;
  statistics_.cpu_seconds += reply.counters().cpu_seconds();
  attempt.job->promise.set_value(std::move(reply));
  end(*attempt.job);
}

void Dispatcher::wait_for_place(Worker& worker, const grpc::Status& status, Clock::time_point now) {
  worker.failing_since.reset();
  worker.busy_delay = std::clamp(2 * worker.busy_delay, kFirstRest, kLongestRest);
  const milliseconds wait =
      std::min(retry_after(status).value_or(worker.busy_delay), kLongestWaitForPlace);
  // Clients that are sent away together shall not come back together; the room that a worker keeps
  // for us is not kept for long.
  const double later = std::uniform_real_distribution<double>(1, 1.1)(random_);
  worker.full_until = now + std::chrono::duration_cast<Clock::duration>(
                                later * std::chrono::duration<double>(wait));
  if (!under_way_.empty()) return;
  if (last_wait_notice_ && now - *last_wait_notice_ < kWaitNoticeInterval) return;
  last_wait_notice_ = now;
  spdlog::warn("{}: {}; waiting for a place", label(worker), message_of(status));
}

void Dispatcher::end(Job& job) {
  job.ended = true;
  for (const auto& attempt : job.under_way) attempt->stop.request_stop();
}

void Dispatcher::fail(Job& job, const Error& error) {
  job.promise.set_exception(std::make_exception_ptr(error));
  end(job);
}

// ---- Workers that fail -------------------------------------------------------------------------

bool Dispatcher::take_down(Worker& worker, const std::string& reason, Clock::time_point now) {
  worker.last_failure = reason;
  if (!worker.failing_since) worker.failing_since = now;
  return std::exchange(worker.connected, false);
}

void Dispatcher::exclude(Worker& worker, const std::string& reason) {
  spdlog::warn("{}: {}; it is set aside for good", label(worker), reason);
  worker.excluded = true;
  worker.connected = false;
  worker.last_failure = reason;
}

milliseconds Dispatcher::next_probe_delay(size_t worker) {
  const milliseconds probe_delay = workers_.at(worker).probe_delay;
  workers_.at(worker).probe_delay = std::clamp(2 * probe_delay, kFirstRest, kLongestRest);
  return probe_delay;
}

void Dispatcher::on_probe(size_t number, const grpc::Status& status,
                          const v1::Capabilities& capabilities, Clock::time_point now) {
  Worker& worker = workers_.at(number);
  if (worker.excluded) return;
  const bool was_unfit = std::exchange(worker.incompatible, is_incompatible(status));
  worker.refuses = worker.incompatible || status.error_code() == grpc::StatusCode::UNAUTHENTICATED;
  if (status.ok()) {
    worker.connected = true;
    worker.never_connected = false;
    worker.capabilities = capabilities;
    // It rendered until it was lost, or was busy with others' renders. How often a render may be
    // lost, its own count says.
    if (std::exchange(worker.only_lost, false)) worker.failing_since.reset();
    return;
  }
  const bool too_late = status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
  const std::string reason = describe(status);
  if (worker.incompatible && !was_unfit)
    spdlog::warn("{}: {}; it is not used", label(worker), reason);
  // That it took too long says less than what was noted before.
  take_down(worker, too_late ? worker.last_failure : reason, now);
  if (worker.never_connected && any_connected() && now - *worker.failing_since > kWorthSaying) {
    worker.never_connected = false;
    spdlog::warn("{}: {}; it is used when it answers", label(worker), worker.last_failure);
  }
  fail_unservable(now);
}

bool Dispatcher::any_connected() const {
  return std::ranges::any_of(
      workers_, [](const auto& entry) { return entry.second.connected && !entry.second.left; });
}

bool Dispatcher::has_workers() const {
  return std::ranges::any_of(workers_, [](const auto& entry) { return !entry.second.left; });
}

bool Dispatcher::all_refuse() const {
  return has_workers() && std::ranges::all_of(workers_, [](const auto& entry) {
           return entry.second.left || entry.second.refuses;
         });
}

std::string Dispatcher::last_failures() const {
  std::string failures;
  for (const auto& [number, worker] : workers_) {
    if (worker.left) continue;
    failures +=
        fmt::format("{}{}: {}", failures.empty() ? "" : "; ", label(worker), worker.last_failure);
  }
  return failures;
}

// ---- Renders that fail -------------------------------------------------------------------------

void Dispatcher::fail_unservable(Clock::time_point now) {
  std::erase_if(waiting_, [&](const std::shared_ptr<Job>& job) {
    const std::optional<Error> error = unservable(*job, now);
    if (error) fail(*job, *error);
    return error.has_value();
  });
}

// Why no worker will do it, if so. One that is connected will get to it; one that answers but fails
// every render is not connected while it rests.
std::optional<Error> Dispatcher::unservable(const Job& job, Clock::time_point now) const {
  if (job.losses.size() >= kMaxFailures) {
    return Error(ErrorKind::kUnavailable,
                 fmt::format("{} was lost {} times and is given up: {}", describe(job.render),
                             job.losses.size(), fmt::join(job.losses, "; ")));
  }
  if (job.refusals.size() >= kMaxFailures) return job.all_refusals();
  if (!has_workers()) return {};
  bool one_is_left = false;
  for (const auto& [i, worker] : workers_) {
    if (worker.left || worker.excluded || job.refused_by(i)) continue;
    if (worker.connected || !worker.failing_since) return {};
    if (now - std::max(*worker.failing_since, job.submitted) < give_up_after_) return {};
    one_is_left = true;
  }
  if (!job.refusals.empty()) return job.all_refusals();
  const std::string why =
      one_is_left ? fmt::format("has answered for {} s", in_seconds(give_up_after_)) : "is left";
  return Error(ErrorKind::kUnavailable,
               fmt::format("no render worker {} ({})", why, last_failures()));
}

void Dispatcher::close() {
  closed_ = true;
  for (const auto& [number, attempt] : under_way_) attempt->stop.request_stop();
  for (const auto& job : waiting_) {
    fail(*job, Error(ErrorKind::kCancelled, "the render pool was closed"));
  }
  waiting_.clear();
}

}  // namespace itn
