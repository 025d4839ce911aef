// Calls of a benchmark on workers of this process: a real one, and one that does as a test says.
#include "client/bench/bench_call.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <future>

#include "common/rpc/channel.h"
#include "server/render/render_server.h"
#include "tests/support/fake_worker.h"
#include "tests/support/process.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using testing::FakeWorker;

RenderJob small_job() {
  RenderJob job;
  job.scene = serialize(testing::cube_scene());
  job.request = testing::small_request();
  return job;
}

std::vector<std::shared_ptr<grpc::Channel>> channels_to(const std::string& address, int count = 1) {
  const Connector connector;
  std::vector<std::shared_ptr<grpc::Channel>> channels;
  for (int i = 0; i < count; ++i) channels.push_back(connector.connect_to(address));
  return channels;
}

BenchWindow measure(BenchCaller& caller, const LoadOptions& options, size_t calls) {
  Load load(options, [&](const std::stop_token& stop, Load::Done done) {
    caller.start(stop, std::move(done));
  });
  return load.measure(0, calls, std::chrono::duration<double>(testing::kPatience).count(), {});
}

TEST(BenchCaller, SendsTheSceneOnceAndCountsWhatWasTraced) {
  RenderServerOptions options;
  options.listen = "127.0.0.1:0";
  options.service.threads = 1;
  RenderServer server(options);
  BenchCaller caller(channels_to(server.address()), bench_request(small_job()), 60s);
  double units = 0;
  ASSERT_TRUE(caller.try_once(units).ok());
  EXPECT_EQ(units, 16 * 12 * 8);
  EXPECT_EQ(caller.unit(), "paths");
  const BenchWindow window = measure(caller, {.callers = 4}, 20);
  EXPECT_GE(window.answered(), 20U);
  EXPECT_EQ(window.ended(), window.answered());
  std::map<std::string, uint64_t> answers;
  const v1::ServerStatus status = server.status();
  for (const v1::AnswerCount& count : status.methods(0).answers()) {
    answers[count.status()] = count.count();
  }
  EXPECT_EQ(answers["FAILED_PRECONDITION"], 1U) << "it asked for the scene once";
  EXPECT_GE(answers["OK"], 21U);
}

TEST(BenchCaller, HoldsHundredsOfCallsWithFewThreads) {
  constexpr size_t kCalls = 300;
  std::atomic<size_t> running = 0;
  testing::Gate gate;
  const FakeWorker worker([&](const grpc::ServerContext& context,
                              const v1::RenderGradRequest& request, v1::RenderGradReply& reply) {
    if (++running == kCalls) gate.open();
    gate.pass(context);
    return testing::constant_answer(request, reply);
  });
  BenchCaller caller(channels_to(worker.address(), 2), bench_request(small_job()), 60s);
  const BenchWindow window = measure(caller, {.callers = kCalls}, kCalls);
  EXPECT_GE(window.answered(), kCalls) << "which the worker answered when all were there";
}

TEST(BenchCaller, StopsCallsThatAreUnderWay) {
  testing::Gate never;
  const FakeWorker worker(
      [&](const grpc::ServerContext& context, const v1::RenderGradRequest&, v1::RenderGradReply&) {
        never.pass(context);
        return grpc::Status::CANCELLED;
      });
  BenchCaller caller(channels_to(worker.address()), bench_request(small_job()), 3600s);
  const auto load = std::make_unique<Load>(
      LoadOptions{.callers = 5},
      [&](const std::stop_token& stop, Load::Done done) { caller.start(stop, std::move(done)); });
  EXPECT_TRUE(testing::eventually([&] { return worker.renders() == 5; }));
}  // which would take an hour

TEST(BenchCaller, TellsRefusedCallsFromOthers) {
  std::atomic<int> asked = 0;
  const FakeWorker worker([&](const grpc::ServerContext&, const v1::RenderGradRequest& request,
                              v1::RenderGradReply& reply) {
    switch (asked++ % 3) {
      case 0: return testing::busy(0.001);
      case 1: return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "too much");
      default: return testing::constant_answer(request, reply);
    }
  });
  BenchCaller caller(channels_to(worker.address()), bench_request(small_job()), 60s);
  const BenchWindow window = measure(caller, {.callers = 1}, 9);
  EXPECT_GE(window.refused, 3U);
  EXPECT_GE(window.failed.at("RESOURCE_EXHAUSTED"), 3U);
  EXPECT_GE(window.answered(), 3U);
}

TEST(BenchCaller, TriesAgainWhileAServerIsBusy) {
  std::atomic<int> asked = 0;
  const FakeWorker worker([&](const grpc::ServerContext&, const v1::RenderGradRequest& request,
                              v1::RenderGradReply& reply) {
    if (asked++ < 2) return testing::busy(0.001);
    reply.mutable_counters()->set_paths(17);
    return testing::constant_answer(request, reply);
  });
  BenchCaller caller(channels_to(worker.address()), bench_request(small_job()), 60s);
  double units = 0;
  EXPECT_TRUE(caller.try_once(units).ok());
  EXPECT_EQ(asked, 3);
  EXPECT_EQ(units, 17);
}

TEST(BenchCaller, EndsACallByItsTimeout) {
  testing::Gate never;
  const FakeWorker worker(
      [&](const grpc::ServerContext& context, const v1::RenderGradRequest&, v1::RenderGradReply&) {
        never.pass(context);
        return grpc::Status::CANCELLED;
      });
  BenchCaller caller(channels_to(worker.address()), bench_request(small_job()), 20ms);
  double units = 0;
  EXPECT_EQ(caller.try_once(units).error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
}

}  // namespace
}  // namespace itn
