#include "server/rpc/queued_call.h"

#include <fmt/format.h>
#include <grpcpp/security/auth_context.h>
#include <grpcpp/server_context.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/logging.h"
#include "common/printable.h"
#include "common/rpc/host_port.h"
#include "common/rpc/request_id.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

// Who showed a certificate is who it names, however many machines and connections they call from;
// others are their machine. A token, which clients share, tells nobody apart.
QueueClient client_of(const grpc::CallbackServerContext& context) {
  const std::string connection = context.peer();
  const std::shared_ptr<const grpc::AuthContext> shown = context.auth_context();
  if (!shown || !shown->IsPeerAuthenticated()) return {host_of_peer(connection), connection};
  std::string who = "certificate";
  for (const grpc::string_ref& name : shown->GetPeerIdentity()) {
    who.append(" ").append(name.data(), name.size());
  }
  return {who, connection};
}

using std::chrono::duration;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kWatchInterval{50};

// A reply waits for its reader so long and no longer: this, and its bytes over this rate.
constexpr seconds kReplyPatience{20};
constexpr double kMinBytesPerSecond = 4 << 20;

// Whoever is asked to send the scene comes again with it: that is no failure.
bool asks_for_scene(const grpc::Status& status) {
  return status.error_code() == grpc::StatusCode::FAILED_PRECONDITION;
}

}  // namespace

// ---- CallScheduler ----

CallScheduler::CallScheduler(const CallSchedulerOptions& options)
    : options_(options),
      memory_(options.memory_bytes,
              {options.memory_beside, [this] { return queue_.seconds_until_next_end(); }}),
      queue_(options.threads, options.queue_capacity),
      watchdog_([this](const std::stop_token& stop) { watch(stop); }) {}

CallScheduler::~CallScheduler() {
  while (!drain(duration<double>(0))) spdlog::warn("still waiting for work that does not stop");
}

bool CallScheduler::drain(duration<double> patience) {
  queue_.close();
  std::unique_lock lock(mutex_);
  const auto none = [this] { return calls_.empty(); };
  if (changed_.wait_for(lock, patience, none)) return true;
  // Others are answered, and gRPC is about to be done with them.
  const auto unanswered = std::count_if(
      calls_.begin(), calls_.end(), [](const QueuedCall* call) { return call->answered_ == 0; });
  if (unanswered > 0 && patience.count() > 0) {
    spdlog::info("stopping {} {} not done within {} s", unanswered,
                 unanswered == 1 ? "call that is" : "calls that are", patience.count());
  }
  for (QueuedCall* call : calls_) call->stop(QueuedCall::Reason::kServer);
  lock.unlock();
  queue_.drop_stopped();
  const auto end = std::chrono::steady_clock::now() + options_.stop_patience;
  if (!queue_.drain_for(options_.stop_patience)) return false;
  lock.lock();
  // Their answers are on the way; who does not read them now does not get them.
  if (changed_.wait_for(lock, seconds(1), none)) return true;
  for (QueuedCall* call : calls_) call->context_.TryCancel();
  changed_.wait_until(lock, end, none);
  return true;
}

void CallScheduler::describe(ServerMetrics& metrics) const {
  metrics.running = running();
  metrics.waiting = waiting();
  metrics.max_running = static_cast<uint64_t>(options_.threads);
  metrics.max_waiting = options_.queue_capacity;
  metrics.methods = counts_.methods();
}

void CallScheduler::add(QueuedCall* call) {
  const std::lock_guard lock(mutex_);
  calls_.insert(call);
  changed_.notify_all();
}

void CallScheduler::remove(QueuedCall* call) {
  const std::lock_guard lock(mutex_);
  calls_.erase(call);
  changed_.notify_all();
}

void CallScheduler::watch(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    changed_.wait(lock, stop, [this] { return !calls_.empty(); });
    for (QueuedCall* call : calls_) call->check_time_limit(QueuedCall::Clock::now());
    changed_.wait_for(lock, stop, kWatchInterval, [] { return false; });
  }
}

// ---- QueuedCall ------------------------------------------------------------------------------

QueuedCall::QueuedCall(CallScheduler& scheduler, grpc::CallbackServerContext& context,
                       grpc::ByteBuffer& reply)
    : scheduler_(scheduler), context_(context), reply_(reply), memory_(scheduler.memory_) {}

void QueuedCall::start(const grpc::ByteBuffer* request) {
  try {
    enqueue(request);
  } catch (...) {
    finish(status_of_current_exception());
  }
}

void QueuedCall::enqueue(const grpc::ByteBuffer* request) {
  JobQueue::QueueSlot place = scheduler_.queue_.admit(client_of(context_));
  {
    // gRPC would keep the bytes until the call is done with, and says "const" of what nobody else
    // looks at.
    grpc::ByteBuffer bytes;
    bytes.Swap(const_cast<grpc::ByteBuffer*>(request));
    try {
      memory_.resize(2 * bytes.Length());  // and the message that it becomes
    } catch (const StatusError&) {
      // Memory is for whoever comes when there is some; a place is not what keeps this one waiting.
      place.reserve_for_client(scheduler_.queue_.seconds_until_next_end());
      throw;
    }
    try {
      accept(bytes);
    } catch (const StatusError& error) {
      if (asks_for_scene(error.status())) place.reserve_for_client();  // it need not queue up again
      throw;
    }
  }
  accepted_ = true;
  scheduler_.add(this);
  scheduler_.queue_.submit(std::move(place), {.stop = stop_.get_token(),
                                              .run = [this] { run(); },
                                              .drop = [this] { finish(status_of_stop()); }});
}

void QueuedCall::run() {
  grpc::Status status;
  try {
    began_ = Clock::now().time_since_epoch().count();
    reply_ = work(stop_.get_token());
    reply_bytes_ = reply_.Length();
    memory_.resize(reply_bytes_);
  } catch (...) {
    status = status_of_current_exception();
    memory_.resize(0);
    if (status.error_code() == grpc::StatusCode::CANCELLED) status = status_of_stop();
    spdlog::debug("call failed: {}", status.error_message());
  }
  finish(status);
}

// The last thing that a thread of ours does with the call.
void QueuedCall::finish(const grpc::Status& status) {
  answered_ = Clock::now().time_since_epoch().count();
  tell(status);
  Finish(status);
}

// A call is answered even if there is no memory for a line about it.
void QueuedCall::tell(const grpc::Status& status) noexcept try {
  CallRecord record{.method = method(),
                    .status = status.error_code(),
                    .times = std::nullopt,
                    .units = units(),
                    .unit = unit()};
  if (const Clock::rep began = began_; began != 0) {
    const auto seconds = [](Clock::rep from, Clock::rep to) {
      return duration<double>(Clock::duration(to - from)).count();
    };
    record.times = {.queue = seconds(arrived_.time_since_epoch().count(), began),
                    .work = seconds(began, answered_)};
  }
  scheduler_.counts_.record(record);
  if (!scheduler_.options_.log_calls) return;
  log(record, status);
} catch (const std::bad_alloc&) {
}

void QueuedCall::log(const CallRecord& record, const grpc::Status& status) const {
  const std::string request = request_id_of(context_), client = printable(context_.peer());
  std::string line =
      fmt::format("{} {} of {}: {}", method(), request, client, status_name(status.error_code()));
  std::vector<LogField> fields = {{"method", std::string(method())},
                                  {"request", request},
                                  {"client", client},
                                  {"status", status_name(status.error_code())}};
  if (record.times) {
    const double queue_ms = 1e3 * record.times->queue, work_ms = 1e3 * record.times->work;
    line += fmt::format(", waited {:.1f} ms, worked {:.1f} ms, {:.0f} {}", queue_ms, work_ms,
                        record.units, record.unit);
    fields.push_back({"queue_ms", queue_ms});
    fields.push_back({"work_ms", work_ms});
    fields.push_back({std::string_view(record.unit), record.units});
  }
  if (!status.ok()) {
    const std::string error = printable(status.error_message(), 200);
    line += ", " + error;
    fields.push_back({"error", error});
  }
  if (asks_for_scene(status)) {
    log_with_fields(spdlog::level::debug, line, fields);
  } else if (const auto left_out = scheduler_.log_limit_.admit()) {
    if (*left_out > 0) spdlog::info("{} calls were answered without a line here", *left_out);
    log_with_fields(spdlog::level::info, line, fields);
  }
}

grpc::Status QueuedCall::status_of_stop() const {
  switch (reason_.load()) {
    case Reason::kTime:
      return {grpc::StatusCode::RESOURCE_EXHAUSTED,
              fmt::format("{} took longer than the {:g} s that this server gives a request "
                          "(--max-seconds): ask for less at a time",
                          activity(), scheduler_.options_.max_time.count())};
    case Reason::kServer:
      return to_status(Error(ErrorKind::kUnavailable, "this server is stopping"));
    case Reason::kClient:
    case Reason::kNone: break;
  }
  return {grpc::StatusCode::CANCELLED, "cancelled by the client"};
}

// By the client, by a lost connection, or because the deadline has passed.
void QueuedCall::OnCancel() {
  stop(Reason::kClient);
  scheduler_.queue_.drop_stopped();
}

void QueuedCall::OnDone() {
  if (accepted_) scheduler_.remove(this);
  delete this;
}

void QueuedCall::stop(Reason reason) {
  Reason none = Reason::kNone;
  reason_.compare_exchange_strong(none, reason);
  stop_.request_stop();
}

void QueuedCall::check_time_limit(Clock::time_point now) {
  const auto since = [&](Clock::rep time) {
    return duration<double>(now.time_since_epoch() - Clock::duration(time)).count();
  };
  if (const Clock::rep answered = answered_; answered != 0) {
    const double patience = static_cast<double>(kReplyPatience.count()) +
                            static_cast<double>(reply_bytes_) / kMinBytesPerSecond;
    if (since(answered) > patience) context_.TryCancel();
    return;
  }
  const Clock::rep began = began_;
  const double most = scheduler_.options_.max_time.count();
  if (began != 0 && most > 0 && since(began) > most) stop(Reason::kTime);
}

grpc::ServerUnaryReactor* answer_at_once(grpc::CallbackServerContext& context,
                                         const std::function<void()>& answer) {
  grpc::ServerUnaryReactor* const reactor = context.DefaultReactor();
  grpc::Status status;
  try {
    answer();
  } catch (...) {
    status = status_of_current_exception();
  }
  reactor->Finish(status);
  return reactor;
}

}  // namespace itn
