// The render pool with workers that do what workers should not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "common/error.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/fake_worker.h"
#include "tests/support/process.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using grpc::ServerContext;
using grpc::Status;
using grpc::StatusCode;
using namespace testing;
using Request = v1::RenderGradRequest;
using Reply = v1::RenderGradReply;

RenderPoolOptions pool_of(const std::vector<const FakeWorker*>& workers) {
  RenderPoolOptions options;
  for (const FakeWorker* worker : workers) options.workers.push_back(worker->address());
  return options;
}

RenderJob job(uint64_t seed) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene(16, 12));
  job.request = testing::small_request();
  job.request.set_seed(seed);
  return job;
}

std::vector<std::future<Reply>> submit(RenderPool& pool, int count) {
  std::vector<std::future<Reply>> futures;
  for (int seed = 0; seed < count; ++seed) futures.push_back(pool.submit(job(seed)));
  return futures;
}

// That each reply is the one to its render.
void expect_answers(std::vector<std::future<Reply>> futures) {
  for (size_t seed = 0; seed < futures.size(); ++seed) {
    Reply expected;
    testing::constant_answer(job(seed).request, expected);
    EXPECT_EQ(futures[seed].get().SerializeAsString(), expected.SerializeAsString());
  }
}

FakeWorker::Render fails(StatusCode code) {
  return [code](const ServerContext&, const Request&, Reply&) { return Status(code, "oh"); };
}

class FailingWorker : public ::testing::TestWithParam<StatusCode> {};

TEST_P(FailingWorker, LeavesItsRendersToAnother) {
  FakeWorker good(answers);
  FakeWorker bad(fails(GetParam()));
  RenderPool pool(pool_of({&bad, &good}));
  auto futures = submit(pool, 20);
  expect_answers(std::move(futures));
  // Both are used as soon as both are up.
  ASSERT_TRUE(eventually([&] {
    expect_answers(submit(pool, 4));
    return bad.renders() > 0;
  }));
}

INSTANTIATE_TEST_SUITE_P(Pool, FailingWorker,
                         ::testing::Values(StatusCode::CANCELLED, StatusCode::INTERNAL,
                                           StatusCode::UNKNOWN, StatusCode::ABORTED,
                                           StatusCode::DATA_LOSS, StatusCode::RESOURCE_EXHAUSTED,
                                           StatusCode::UNAVAILABLE),
                         [](const auto& test) {
                           return "Status" + std::to_string(static_cast<int>(test.param));
                         });

TEST(FailingWorkers, TellACancelledRenderFromOneThatWeCancel) {
  std::atomic<int> calls = 0;
  FakeWorker worker([&](const ServerContext& context, const Request& request, Reply& reply) {
    return ++calls <= 3 ? Status::CANCELLED : answers(context, request, reply);
  });
  RenderPool pool(pool_of({&worker}));
  expect_answers(submit(pool, 5));
}

// More clients than the worker has places; no client gives up after any time at all.
TEST(FailingWorkers, ServeAllClientsOfABusyOne) {
  Gate gate;
  std::atomic<int> inside = 0, sent_away = 0;
  FakeWorker worker([&](const ServerContext& context, const Request& request, Reply& reply) {
    Status status = testing::busy(0.002);
    if (++inside <= 2) {
      gate.pass(context);
      status = answers(context, request, reply);
    } else {
      ++sent_away;
    }
    --inside;
    return status;
  });
  RenderPoolOptions options = pool_of({&worker});
  options.give_up_after = 1ms;
  constexpr int kClients = 8;
  std::vector<std::unique_ptr<RenderPool>> pools;
  std::vector<std::vector<std::future<Reply>>> futures;
  for (int i = 0; i < kClients; ++i) {
    pools.push_back(std::make_unique<RenderPool>(options));
    futures.push_back(submit(*pools.back(), 4));
  }
  ASSERT_TRUE(eventually([&] { return sent_away > 20 * kClients; }));
  gate.open();
  for (auto& of_client : futures) expect_answers(std::move(of_client));
}

// A worker that is held for good, as by a render that never ends.
TEST(FailingWorkers, DoNotHoldUpWhatAnIdleOneCanDo) {
  Gate never;
  std::atomic<int> cancelled = 0;
  FakeWorker held([&](const ServerContext& context, const Request&, Reply&) {
    if (!never.pass(context)) ++cancelled;
    return Status::CANCELLED;
  });
  FakeWorker idle(answers);
  RenderPool pool(pool_of({&held, &idle}));
  // Steps as of a training: each needs all of its renders.
  for (int step = 0; step < 3; ++step) expect_answers(submit(pool, 8));
  ASSERT_TRUE(eventually([&] {
    expect_answers(submit(pool, 8));
    return pool.statistics().hedges > 0;
  }));
  EXPECT_TRUE(eventually([&] { return cancelled > 0; }));  // nobody waits for it any more
  EXPECT_EQ(pool.statistics().retries, 0U);
}

TEST(FailingWorkers, OfAnotherVersionAreNotUsed) {
  v1::Capabilities other;
  other.set_version("0.0.1");
  FakeWorker old(answers, other), good(answers);
  {
    RenderPool pool(pool_of({&old, &good}));
    expect_answers(submit(pool, 20));
    EXPECT_EQ(old.renders(), 0);
  }
  // At once, as no other answer will come.
  RenderPoolOptions options = pool_of({&old});
  options.connect_within = std::chrono::hours(1);
  expect_error(ErrorKind::kUnavailable, {old.address(), "0.0.1", ITN_VERSION},
               [&] { RenderPool pool(options); });
}

TEST(FailingWorkers, CannotSteerTheTerminalByTheirVersion) {
  v1::Capabilities other;
  other.set_version("\x1b[2J" + std::string(1 << 20, '9'));
  FakeWorker strange(answers, other);
  try {
    RenderPool pool(pool_of({&strange}));
    FAIL() << "it is used";
  } catch (const Error& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("\\x1b[2J999"), std::string::npos) << message.substr(0, 300);
    EXPECT_EQ(message.find('\x1b'), std::string::npos);
    EXPECT_LT(message.size(), 1000U);
  }
}

// By which it is found in the worker's log.
TEST(FailingWorkers, AreNamedWithTheRequest) {
  std::mutex mutex;
  std::string name;
  const FakeWorker worker([&](const ServerContext& context, const Request&, Reply&) {
    const std::lock_guard lock(mutex);
    const grpc::string_ref id = context.client_metadata().find("x-request-id")->second;
    name.assign(id.data(), id.size());
    return Status(StatusCode::INVALID_ARGUMENT, "spp is odd");
  });
  RenderPool pool(pool_of({&worker}));
  try {
    pool.submit(job(1)).get();
    ADD_FAILURE() << "it was rendered";
  } catch (const Error& error) {
    const std::lock_guard lock(mutex);
    EXPECT_EQ(name.size(), 16U);
    EXPECT_EQ(error.what(), "worker " + worker.address() + ": spp is odd (request " + name + ")");
  }
}

}  // namespace
}  // namespace itn
