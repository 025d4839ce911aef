// Calls that do what a test says, behind a server of this process.
#include "server/rpc/queued_call.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <semaphore>
#include <string>
#include <thread>
#include <vector>

#include "client/rpc/channel.h"
#include "common/error.h"
#include "common/rpc/status.h"
#include "itn/v1/render.grpc.pb.h"
#include "server/rpc/byte_buffer.h"
#include "server/rpc/grpc_server.h"
#include "tests/support/captured_log.h"
#include "tests/support/process.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using ::testing::Not;

// What RenderGrad does, by the seed of the request.
struct Behaviour {
  std::function<void(uint64_t seed, const grpc::CallbackServerContext&)> accept =
      [](uint64_t, const grpc::CallbackServerContext&) {};
  std::function<void(uint64_t seed, const std::stop_token&)> work = [](uint64_t,
                                                                       const std::stop_token&) {};
  // Once the call has its place in the queue, or was refused.
  std::function<void(uint64_t seed)> taken = [](uint64_t) {};
};

uint64_t seed_of(grpc::ByteBuffer request) {
  v1::RenderGradRequest message;
  grpc::SerializationTraits<v1::RenderGradRequest>::Deserialize(&request, &message);
  return message.seed();
}

class TestService final
    : public v1::RenderService::WithRawCallbackMethod_RenderGrad<v1::RenderService::Service> {
 public:
  TestService(Behaviour behaviour, CallSchedulerOptions options)
      : behaviour_(std::move(behaviour)), scheduler_(options) {}

  grpc::ServerUnaryReactor* RenderGrad(grpc::CallbackServerContext* context,
                                       const grpc::ByteBuffer* request,
                                       grpc::ByteBuffer* reply) override {
    const uint64_t seed = seed_of(*request);
    grpc::ServerUnaryReactor* const call =
        start_call<Call>(*context, request, *this, *context, *reply);
    behaviour_.taken(seed);
    return call;
  }

  CallScheduler& scheduler() { return scheduler_; }

 private:
  class Call final : public QueuedCall {
   public:
    Call(TestService& service, grpc::CallbackServerContext& context, grpc::ByteBuffer& reply)
        : QueuedCall(service.scheduler_, context, reply), service_(service), context_(context) {}

   private:
    void accept(const grpc::ByteBuffer& bytes) override {
      parse_checked(bytes, "request", {}, request_);
      service_.behaviour_.accept(request_.seed(), context_);
    }
    grpc::ByteBuffer work(std::stop_token stop) override {
      service_.behaviour_.work(request_.seed(), stop);
      return serialized(v1::RenderGradReply());
    }
    std::string activity() const override { return "a test"; }
    std::string_view method() const override { return "RenderGrad"; }
    double units() const override { return 3; }
    std::string_view unit() const override { return "tests"; }

    TestService& service_;
    grpc::CallbackServerContext& context_;
    v1::RenderGradRequest request_;
  };

  const Behaviour behaviour_;
  CallScheduler scheduler_;
};

class QueuedCallTest : public ::testing::Test {
 protected:
  void serve(Behaviour behaviour, size_t queue_capacity, uint64_t memory_bytes = 0) {
    CallSchedulerOptions options;
    options.queue_capacity = queue_capacity;
    options.memory_bytes = memory_bytes;
    options.max_time = 0s;
    options.stop_patience = stop_patience;
    options.log_calls = log_calls;
    service_ = std::make_unique<TestService>(std::move(behaviour), options);
    GrpcServerOptions server;
    server.listen = "127.0.0.1:0";
    server_ =
        std::make_unique<GrpcServer>(server, *service_, v1::RenderService::service_full_name());
    stub_ = v1::RenderService::NewStub(server_->in_process_channel());
  }

  grpc::Status call(uint64_t seed, size_t bytes = 0) {
    grpc::ClientContext context;
    return call(seed, context, bytes);
  }
  grpc::Status call(uint64_t seed, grpc::ClientContext& context, size_t bytes = 0) {
    v1::RenderGradRequest request;
    request.set_seed(seed);
    request.set_scene(std::string(bytes, 'x'));
    v1::RenderGradReply reply;
    return stub_->RenderGrad(&context, request, &reply);
  }
  std::future<grpc::Status> call_apart(uint64_t seed, size_t bytes = 0) {
    return std::async(std::launch::async, [this, seed, bytes] { return call(seed, bytes); });
  }
  std::future<grpc::Status> call_apart(uint64_t seed, grpc::ClientContext& context) {
    return std::async(std::launch::async, [this, seed, &context] { return call(seed, context); });
  }
  // By a connection of its own.
  std::unique_ptr<v1::RenderService::Stub> another_client() const {
    return v1::RenderService::NewStub(Connector().connect_to(server_->address()));
  }
  CallScheduler& scheduler() { return service_->scheduler(); }

  std::chrono::duration<double> stop_patience = testing::kPatience;
  bool log_calls = false;
  std::unique_ptr<TestService> service_;
  std::unique_ptr<GrpcServer> server_;
  std::unique_ptr<v1::RenderService::Stub> stub_;
};

// A failed call in the log wants somebody to look at it; this one is made again with its scene.
TEST_F(QueuedCallTest, ThatIsAskedForItsSceneIsNoFailureInTheLog) {
  const testing::CapturedLog log;
  log_calls = true;
  serve({.accept =
             [](uint64_t seed, const grpc::CallbackServerContext&) {
               if (seed == 1) {
                 throw StatusError({grpc::StatusCode::FAILED_PRECONDITION, "send the scene"});
               }
             }},
        4);
  EXPECT_EQ(call(1).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(call(2).ok());
  EXPECT_THAT(log.text(), HasSubstr(": OK, waited "));
  EXPECT_THAT(log.text(), Not(HasSubstr("send the scene")));
}

// Open when it goes out of scope at the latest.
class Gate {
 public:
  ~Gate() { open(); }
  void open() {
    if (!open_.exchange(true)) promise_.set_value();
  }
  void pass() const { opened_.wait(); }

 private:
  std::atomic<bool> open_ = false;
  std::promise<void> promise_;
  std::shared_future<void> opened_ = promise_.get_future().share();
};

// gRPC tells a call that it was cancelled once it has been accepted, and then it gives up its
// place.
TEST_F(QueuedCallTest, ThatIsCancelledWhileItIsAcceptedLeavesItsPlace) {
  Gate gate;
  std::atomic<bool> comes_in = false;
  serve({.accept =
             [&](uint64_t seed, const grpc::CallbackServerContext& context) {
               if (seed != 2) return;
               comes_in = true;
               EXPECT_TRUE(testing::eventually([&] { return context.IsCancelled(); }));
             },
         .work =
             [&](uint64_t seed, const std::stop_token&) {
               if (seed == 1) gate.pass();
             }},
        1);
  auto first = call_apart(1);
  ASSERT_TRUE(testing::eventually([&] { return scheduler().running() == 1; }));
  grpc::ClientContext context;
  auto cancelled = call_apart(2, context);
  ASSERT_TRUE(testing::eventually([&] { return comes_in.load(); }));
  EXPECT_THAT(call(3).error_message(), HasSubstr("1 run, 0 wait, 1 arrive"));
  context.TryCancel();
  EXPECT_EQ(cancelled.get().error_code(), grpc::StatusCode::CANCELLED);
  // Its place is another's.
  std::vector<std::future<grpc::Status>> others;
  EXPECT_TRUE(testing::eventually([&] {
    others.push_back(call_apart(4));
    return scheduler().waiting() == 1;
  }));
  gate.open();
  EXPECT_TRUE(first.get().ok());
}

// Work that never asks whether it is to stop holds nobody up for longer than is said.
TEST_F(QueuedCallTest, ThatDoesNotStopIsNotWaitedFor) {
  Gate gate;
  stop_patience = 0.2s;
  serve({.work = [&](uint64_t, const std::stop_token&) { gate.pass(); }}, 1);
  auto running = call_apart(1);
  ASSERT_TRUE(testing::eventually([&] { return scheduler().running() == 1; }));
  auto waiting = call_apart(2);
  ASSERT_TRUE(testing::eventually([&] { return scheduler().waiting() == 1; }));
  const auto start = std::chrono::steady_clock::now();
  EXPECT_FALSE(scheduler().drain(0s));
  EXPECT_GE(std::chrono::steady_clock::now() - start, stop_patience);
  EXPECT_EQ(waiting.get().error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(running.wait_for(0s), std::future_status::timeout);
  gate.open();
  EXPECT_TRUE(running.get().ok());
  EXPECT_TRUE(testing::eventually([&] { return scheduler().drain(0s); }));
}

TEST_F(QueuedCallTest, ThatStopsLateIsWaitedFor) {
  serve({.work =
             [](uint64_t, const std::stop_token& stop) {
               EXPECT_TRUE(testing::eventually([&] { return stop.stop_requested(); }));
               throw Error(ErrorKind::kCancelled, "stopped");
             }},
        1);
  auto running = call_apart(1);
  ASSERT_TRUE(testing::eventually([&] { return scheduler().running() == 1; }));
  EXPECT_TRUE(scheduler().drain(0s));
  EXPECT_EQ(running.get().error_code(), grpc::StatusCode::UNAVAILABLE);
}

double retry_after(const grpc::Status& status) {
  v1::Busy busy;
  return busy.ParseFromString(status.error_details()) ? busy.retry_after_seconds() : 0;
}

// There is memory again when a call has ended: that takes as long as calls have taken, and whoever
// comes then finds the place that it had.
TEST_F(QueuedCallTest, ThatFindsNoMemoryIsToldWhenToComeAgain) {
  Gate gate;
  std::atomic<bool> at_work = false;
  constexpr size_t kBytes = 1 << 20;
  serve({.work =
             [&](uint64_t seed, const std::stop_token&) {
               if (seed != 1) return;
               at_work = true;
               gate.pass();
             }},
        1, 3 * kBytes);
  for (int i = 0; i < 40; ++i) ASSERT_TRUE(call(0).ok());  // at once, each
  auto first = call_apart(1, kBytes);
  ASSERT_TRUE(testing::eventually([&] { return at_work.load(); }));
  const grpc::Status status = call(2, kBytes);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_THAT(status.error_message(), HasSubstr("MiB of memory for requests are taken"));
  EXPECT_GT(retry_after(status), 0);
  EXPECT_LT(retry_after(status), 0.9);
  gate.open();
  EXPECT_TRUE(first.get().ok());
  EXPECT_TRUE(testing::eventually([&] { return call(2, kBytes).ok(); }));
}

// Many more than there are places, each of whom comes again when they are told.
TEST_F(QueuedCallTest, ThatIsRefusedIsToldWhenItIsItsTurn) {
  constexpr int kClients = 60, kAnswers = 300;
  serve({.work = [](uint64_t, const std::stop_token&) { std::this_thread::sleep_for(10ms); }}, 16);
  std::atomic<int> answers = 0, refusals = 0;
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < kClients; ++i) {
      clients.emplace_back([&] {
        const auto client = another_client();
        while (answers < kAnswers) {
          grpc::ClientContext context;
          context.set_wait_for_ready(true);  // for its connection
          v1::RenderGradReply reply;
          const grpc::Status status = client->RenderGrad(&context, {}, &reply);
          ++(status.ok() ? answers : refusals);
          if (!status.ok()) {
            std::this_thread::sleep_for(std::chrono::duration<double>(retry_after(status)));
          }
        }
      });
    }
  }
  EXPECT_LT(refusals, 2 * answers);
}

// Others who flood a server get every second turn, whatever they do, while somebody asks for one
// thing after the other and comes again when they are told.
TEST_F(QueuedCallTest, ThatComesOneAtATimeGetsHalfOfAServerThatIsFlooded) {
  constexpr uint64_t kFlood = 1, kPolite = 2;
  constexpr int kPoliteCalls = 20, kFlooding = 64;
  std::counting_semaphore<> turns(0);
  std::mutex mutex;
  std::string order;
  std::atomic<int> asked = 0, admitted = 0, refused = 0;  // of the polite one's
  const auto begun = [&] {
    const std::lock_guard lock(mutex);
    return order.size();
  };
  serve({.accept =
             [&](uint64_t seed, const grpc::CallbackServerContext&) {
               if (seed == kPolite) ++admitted;
             },
         .work =
             [&](uint64_t seed, const std::stop_token&) {
               {
                 const std::lock_guard lock(mutex);
                 order += seed == kPolite ? 'P' : 'F';
               }
               turns.acquire();
             },
         .taken =
             [&](uint64_t seed) {
               if (seed == kPolite) ++asked;
             }},
        8);
  std::atomic<bool> over = false;
  const auto flood = another_client(), polite = another_client();
  const auto ask = [](auto& stub, uint64_t seed) {
    grpc::ClientContext context;
    v1::RenderGradRequest request;
    request.set_seed(seed);
    v1::RenderGradReply reply;
    return stub->RenderGrad(&context, request, &reply);
  };
  std::vector<std::jthread> flooding;
  for (int i = 0; i < kFlooding; ++i) {
    flooding.emplace_back([&] {
      while (!over) {
        ask(flood, kFlood);
        std::this_thread::sleep_for(1ms);  // each of them asks hundreds of times a second
      }
    });
  }
  ASSERT_TRUE(testing::eventually(
      [&] { return scheduler().running() == 1 && scheduler().waiting() == 8; }));
  std::jthread asking([&] {
    for (int answers = 0; answers < kPoliteCalls && !over;) {
      const grpc::Status status = ask(polite, kPolite);
      if (status.ok()) {
        ++answers;
      } else {
        ++refused;
        std::this_thread::sleep_for(std::chrono::duration<double>(retry_after(status)));
      }
    }
  });
  const std::shared_ptr<void> end(nullptr, [&](void*) {  // before the threads are joined
    over = true;
    turns.release(10'000);
  });
  const auto take_turns = [&](int count) {
    for (int i = 0; i < count; ++i) {
      const size_t before = begun();
      turns.release();
      ASSERT_TRUE(testing::eventually([&] { return begun() > before; }));
    }
  };
  // It has a place and takes its turn, or is told to come again, and another has one.
  int calls = 0;
  for (int asks = 0; calls < kPoliteCalls; ++asks) {
    ASSERT_TRUE(testing::eventually([&] { return asked > asks; }));
    const bool has_place = admitted > calls;
    if (has_place) ++calls;
    take_turns(has_place ? 2 : 1);
  }
  const std::lock_guard lock(mutex);
  EXPECT_GT(std::ranges::count(order, 'P'), 0.4 * static_cast<double>(order.size())) << order;
  EXPECT_LT(refused, 2 * kPoliteCalls);
}

}  // namespace
}  // namespace itn
