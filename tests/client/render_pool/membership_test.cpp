// The render pool with workers that join and leave during a run.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "client/render_pool/render_worker.h"
#include "common/error.h"
#include "common/rpc/host_port.h"
#include "server/render/render_server.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/fake_worker.h"
#include "tests/support/process.h"
#include "tests/support/scenes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_authority.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using grpc::ServerContext;
using namespace testing;
using ::testing::HasSubstr;
using Request = v1::RenderGradRequest;
using Reply = v1::RenderGradReply;

RenderJob job(uint64_t seed) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene(16, 12));
  job.request = testing::small_request();
  job.request.set_seed(seed);
  return job;
}

void expect_answer(uint64_t seed, std::future<Reply> future) {
  Reply expected;
  testing::constant_answer(job(seed).request, expected);
  EXPECT_EQ(future.get().SerializeAsString(), expected.SerializeAsString());
}

class Membership : public ::testing::Test {
 protected:
  void list(const std::vector<const FakeWorker*>& workers) const {
    std::string lines;
    for (const FakeWorker* worker : workers) lines += worker->address() + "\n";
    // In one step: no half of the list is ever read.
    folder.write("new", lines);
    std::filesystem::rename(folder.path("new"), folder.path("workers"));
  }

  std::unique_ptr<RenderPool> pool() const {
    RenderPoolOptions options;
    options.workers = {"file:" + folder.path("workers")};
    options.connect_within = 100ms;
    return std::make_unique<RenderPool>(options);
  }

  // Renders until a condition holds.
  template <typename F>
  bool renders_until(RenderPool& pool, const F& condition) {
    return eventually([&] {
      ++count;
      expect_answer(count, pool.submit(job(count)));
      return condition();
    });
  }

  TemporaryFolder folder;
  uint64_t count = 0;  // of renders
};

TEST_F(Membership, GivesRendersToAWorkerThatJoins) {
  FakeWorker a(answers), b(answers);
  list({&a});
  const auto workers = pool();
  EXPECT_EQ(workers->parallelism(), 2);
  EXPECT_TRUE(renders_until(*workers, [&] { return a.renders() > 3; }));
  list({&a, &b});
  // With more under way than a takes.
  EXPECT_TRUE(eventually([&] {
    std::vector<std::future<Reply>> futures;
    for (uint64_t i = 0; i < 8; ++i) futures.push_back(workers->submit(job(++count)));
    for (size_t i = 0; i < 8; ++i) expect_answer(count - 7 + i, std::move(futures[i]));
    return b.renders() > 0;
  }));
  EXPECT_EQ(workers->parallelism(), 4);
  EXPECT_EQ(workers->statistics().jobs, count);
  EXPECT_EQ(workers->statistics().retries, 0U);
}

// By TLS, workers that have a name show a certificate of that name.
TEST(NamedWorkers, AreKnownByTheirName) {
  if (!testing::TestAuthority::is_possible()) GTEST_SKIP() << "needs the program openssl";
  const testing::TestAuthority authority;
  authority.certify_server("DNS:localhost");
  RenderServerOptions listening;
  listening.listen = "127.0.0.1:0";
  listening.security = authority.server();
  const RenderServer server(listening);
  const HostPort name{"localhost", parse_host_port(server.address()).port};
  RenderPoolOptions options;
  options.security = authority.anonymous_client();
  options.workers = {"dns:///" + name.text()};
  EXPECT_EQ(RenderPool(options).submit(job(1)).get().width(), 16U);
  options.workers = {server.address()};
  testing::expect_error(ErrorKind::kUnavailable, {"for 127.0.0.1 (--tls-server-name)"},
                        [&] { RenderPool{options}; });
}

TEST_F(Membership, LetsAWorkerThatLeavesFinish) {
  Gate gate;
  FakeWorker a([&](const ServerContext& context, const Request& request, Reply& reply) {
    gate.pass(context);
    return answers(context, request, reply);
  });
  FakeWorker b(answers);
  list({&a});
  const auto workers = pool();
  std::future<Reply> held = workers->submit(job(1000));
  ASSERT_TRUE(eventually([&] { return a.renders() == 1; }));
  list({&a, &b});
  ASSERT_TRUE(eventually([&] { return workers->parallelism() == 4; }));
  list({&b});
  ASSERT_TRUE(eventually([&] { return workers->parallelism() == 2; }));
  gate.open();
  expect_answer(1000, std::move(held));
  EXPECT_TRUE(renders_until(*workers, [&] { return b.renders() > 20; }));
  EXPECT_EQ(a.renders(), 1);
  EXPECT_EQ(workers->statistics().jobs, count + 1);
}

TEST_F(Membership, WaitsForTheFirstWorkerAndSaysForWhat) {
  const testing::CapturedLog log;
  FakeWorker a(answers);
  {
    const auto workers = pool();
    EXPECT_GT(workers->parallelism(), 0);
    std::future<Reply> waiting = workers->submit(job(7));
    EXPECT_EQ(waiting.wait_for(300ms), std::future_status::timeout);
    list({&a});
    expect_answer(7, std::move(waiting));
  }
  EXPECT_THAT(log.text(),
              HasSubstr("there are no render workers; waiting for addresses from file:" +
                        folder.path("workers") + " (no such file yet)"));
}

TEST_F(Membership, WaitsWhileAllWorkersAreGone) {
  FakeWorker a(answers), b(answers);
  list({&a, &b});
  const auto workers = pool();
  EXPECT_TRUE(renders_until(*workers, [&] { return count == 5; }));
  list({});
  ASSERT_TRUE(eventually([&] { return workers->parallelism() == 2; }));  // as if there were one
  const int before = a.renders();
  std::future<Reply> waiting = workers->submit(job(++count));
  list({&b});
  expect_answer(count, std::move(waiting));
  EXPECT_EQ(a.renders(), before);
  EXPECT_EQ(workers->statistics().jobs, count);
}

// A token would go to another machine without TLS: at the start that is an error, later a warning,
// and all others are used.
TEST_F(Membership, LeavesOutWhatMustNotBeConnectedTo) {
  FakeWorker a(answers), b(answers);
  const std::string elsewhere = "192.0.2.1:50051";
  RenderPoolOptions options;
  options.security.token_file = folder.write("token", std::string(32, 'x'));
  options.workers = {a.address(), elsewhere};
  testing::expect_error(ErrorKind::kUsage, {elsewhere, "unencrypted"},
                        [&] { RenderPool pool(options); });
  const auto list_with = [&](const std::string& addresses) {
    folder.write("new", addresses);
    std::filesystem::rename(folder.path("new"), folder.path("workers"));
  };
  const testing::CapturedLog log;
  {
    list_with(a.address() + "\n");
    options.workers = {"file:" + folder.path("workers")};
    RenderPool pool(options);
    list_with(elsewhere + "\n" + b.address() + "\n");
    EXPECT_TRUE(renders_until(pool, [&] { return b.renders() > 3; }));
    EXPECT_EQ(pool.parallelism(), 2);
  }
  EXPECT_THAT(log.text(), HasSubstr(elsewhere + " unencrypted"));
}

// ---- Many --------------------------------------------------------------------------------------

// Answers at once, and fails every seventh render, as if it were gone for a moment.
class HastyWorker final : public RenderWorker {
 public:
  explicit HastyWorker(bool fails) : fails_(fails) {}

  grpc::Status probe(bool /*patient*/, const std::stop_token& /*stop*/,
                     v1::Capabilities& /*capabilities*/) override {
    return grpc::Status::OK;
  }
  Answer render(const RenderJob& job, std::chrono::milliseconds /*deadline*/,
                const std::stop_token& /*stop*/) override {
    if (fails_ && ++renders_ % 7 == 0) {
      return {.outcome = Outcome::kUnreachable, .status = grpc::Status::CANCELLED, .reply = {}};
    }
    Answer answer{.outcome = Outcome::kAnswered, .status = {}, .reply = {}};
    answer.reply.set_loss(static_cast<double>(job.request.seed()));
    return answer;
  }

 private:
  const bool fails_;
  std::atomic<int> renders_ = 0;
};

TEST(ManyWorkers, LoseNothing) {
  const spdlog::level::level_enum level = spdlog::get_level();
  spdlog::set_level(spdlog::level::err);  // the failures are many
  RenderPoolOptions options;
  for (int i = 1; i <= 200; ++i) options.workers.push_back("fake:" + std::to_string(i));
  options.connect = [&, made = 0](const std::string&) mutable {
    return std::make_unique<HastyWorker>(++made % 3 == 0);
  };
  RenderPool workers(options);
  std::vector<std::future<Reply>> futures;
  for (uint64_t seed = 0; seed < 5000; ++seed) futures.push_back(workers.submit(job(seed)));
  for (size_t seed = 0; seed < futures.size(); ++seed) {
    EXPECT_EQ(futures[seed].get().loss(), static_cast<double>(seed));
  }
  EXPECT_EQ(workers.statistics().jobs, 5000U);
  spdlog::set_level(level);
}

}  // namespace
}  // namespace itn
