// A unary call as both services answer it: admitted before it is parsed, worked on by a thread of a
// queue, within a share of the server's memory and a time, and answered once.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <new>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <unordered_set>
#include <utility>

#include "server/rpc/job_queue.h"
#include "server/rpc/log_limit.h"
#include "server/rpc/memory_budget.h"
#include "server/rpc/metrics.h"

namespace itn {

class QueuedCall;

// Work that was told to stop has this long before a server no longer waits for it.
inline constexpr std::chrono::seconds kStopPatience{10};

struct CallSchedulerOptions {
  int threads = 1;             // calls worked on at a time
  size_t queue_capacity = 16;  // calls that wait
  uint64_t memory_bytes = 0;   // of all calls together; 0: no limit
  // What else counts as taken of these bytes. From any thread.
  std::function<uint64_t()> memory_beside = [] { return 0; };
  std::chrono::duration<double> max_time;  // of the work on one call; 0: no limit
  bool log_calls = false;                  // a line for each that is answered
  std::chrono::duration<double> stop_patience = kStopPatience;
};

// What the calls of a server share. Thread-safe.
class CallScheduler {
 public:
  explicit CallScheduler(const CallSchedulerOptions& options);
  // Drains without patience, and waits for work that does not stop, however long.
  ~CallScheduler();
  CallScheduler(const CallScheduler&) = delete;
  CallScheduler& operator=(const CallScheduler&) = delete;

  // Answers further calls UNAVAILABLE. Returns when those accepted before are answered and their
  // answers have left for the client, at most `patience` later: then what is still under way is
  // stopped and answered UNAVAILABLE. Work that has not stopped stop_patience after that is not
  // waited for: returns false, and the process can only be ended.
  bool drain(std::chrono::duration<double> patience);

  // Calls that are worked on now, and calls that were accepted and wait for a thread.
  size_t running() const { return queue_.running(); }
  size_t waiting() const { return queue_.waiting(); }

  // Sets what it knows: its calls.
  void describe(ServerMetrics& metrics) const;

 private:
  friend class QueuedCall;

  void add(QueuedCall* call);
  void remove(QueuedCall* call);
  // Stops calls that take too long, and takes back answers that nobody reads.
  void watch(const std::stop_token& stop);

  const CallSchedulerOptions options_;
  CallCounts counts_;
  LogLimit log_limit_{50, std::chrono::seconds(1)};  // lines of calls
  MemoryBudget memory_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::unordered_set<QueuedCall*> calls_;  // accepted and not yet done with
  JobQueue queue_;
  std::jthread watchdog_;  // last: it uses what is above
};

// Deletes itself when gRPC is done with it. Made by start_call().
class QueuedCall : public grpc::ServerUnaryReactor {
 public:
  // Takes over the bytes of `request`, and answers the call in any case. To be called once, on an
  // object made by `new`.
  void start(const grpc::ByteBuffer* request);

  void OnCancel() final;
  void OnDone() final;

 protected:
  QueuedCall(CallScheduler& scheduler, grpc::CallbackServerContext& context,
             grpc::ByteBuffer& reply);
  ~QueuedCall() override = default;

  // Parses and checks what is quickly checked, on a thread of gRPC. Throws what the call is to be
  // answered with.
  virtual void accept(const grpc::ByteBuffer& request) = 0;

  // Works, on a thread of the queue, and returns the reply. Throws what the call is to be answered
  // with, Error (kCancelled) when a stop was requested. What it allocates is in memory() before.
  virtual grpc::ByteBuffer work(std::stop_token stop) = 0;

  // What the call is, e.g. "RenderGrad"; a constant.
  virtual std::string_view method() const = 0;

  // What work() has done, e.g. paths that it traced, and in what unit it counts; a constant.
  virtual double units() const = 0;
  virtual std::string_view unit() const = 0;

  // What work() is at, e.g. "rendering 64 x 64 pixels", for who is told that it took too long. From
  // any thread.
  virtual std::string activity() const = 0;

  MemoryBudget::Share& memory() { return memory_; }

 private:
  friend class CallScheduler;
  using Clock = std::chrono::steady_clock;
  enum class Reason { kNone, kClient, kTime, kServer };

  void enqueue(const grpc::ByteBuffer* request);
  void run();
  void finish(const grpc::Status& status);
  void tell(const grpc::Status& status) noexcept;  // counts and log
  void log(const CallRecord& record, const grpc::Status& status) const;
  grpc::Status status_of_stop() const;
  void stop(Reason reason);
  void check_time_limit(Clock::time_point now);  // by the watchdog

  CallScheduler& scheduler_;
  grpc::CallbackServerContext& context_;
  grpc::ByteBuffer& reply_;
  MemoryBudget::Share memory_;
  std::stop_source stop_;
  std::atomic<Reason> reason_ = Reason::kNone;
  const Clock::time_point arrived_ = Clock::now();
  // Nanoseconds of Clock; 0: not yet.
  std::atomic<Clock::rep> began_ = 0;
  std::atomic<Clock::rep> answered_ = 0;
  std::atomic<uint64_t> reply_bytes_ = 0;
  bool accepted_ = false;
};

// Answers the call on the spot: with what `answer` does, or with what it throws.
grpc::ServerUnaryReactor* answer_at_once(grpc::CallbackServerContext& context,
                                         const std::function<void()>& answer);

// Makes and starts a Call, a kind of QueuedCall; or says that there is no memory for it.
template <typename Call, typename... Arguments>
grpc::ServerUnaryReactor* start_call(grpc::CallbackServerContext& context,
                                     const grpc::ByteBuffer* request, Arguments&&... arguments) {
  Call* call = nullptr;
  try {
    call = new Call(std::forward<Arguments>(arguments)...);
  } catch (const std::bad_alloc&) {
    return answer_at_once(context, [] { throw std::bad_alloc(); });
  }
  call->start(request);
  return call;
}

}  // namespace itn
