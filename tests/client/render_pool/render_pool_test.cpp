// The render pool with real worker processes.
#include "client/render_pool/render_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <future>
#include <list>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/render/local_renderer.h"
#include "common/error.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scenes.h"
#include "tests/support/server_process.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using namespace testing;
using ::testing::HasSubstr;

class WorkerProcess : public testing::ServerProcess {
 public:
  explicit WorkerProcess(const std::string& listen = "127.0.0.1:0",
                         std::vector<std::string> flags = {})
      : ServerProcess(testing::kItnWorker, with_one_thread(std::move(flags)), listen) {}

 private:
  static std::vector<std::string> with_one_thread(std::vector<std::string> flags) {
    flags.insert(flags.end(), {"--threads", "1"});
    return flags;
  }
};

RenderPoolOptions pool_of(const std::vector<std::string>& workers) {
  RenderPoolOptions options;
  options.workers = workers;
  options.embedded_threads = 1;
  return options;
}

// Different scenes and seeds, of unequal cost.
std::vector<RenderJob> jobs(int count, uint32_t spp = 16) {
  std::vector<RenderJob> jobs;
  for (int i = 0; i < count; ++i) {
    RenderJob job;
    job.scene = serialize(cube_scene(16 + i % 3, 12));
    job.request = small_request(spp + static_cast<uint32_t>(i) % 5);
    job.request.set_seed(static_cast<uint64_t>(i));
    jobs.push_back(job);
  }
  return jobs;
}

std::vector<std::string> render_all(JobRenderer& pool, const std::vector<RenderJob>& jobs) {
  std::vector<std::future<v1::RenderGradReply>> futures;
  for (const RenderJob& job : jobs) futures.push_back(pool.submit(job));
  std::vector<std::string> replies;
  for (auto& future : futures) replies.push_back(deterministic_bytes(future.get()));
  return replies;
}

// The pool is ready when its first worker is; a test of both needs the other one, too.
void wait_until_both_render(RenderPool& pool) {
  const RenderJob job = jobs(1, 4)[0];
  ASSERT_TRUE(eventually([&] {
    pool.submit(job).get();
    return pool.statistics().scenes_sent == 2;
  }));
}

ErrorKind kind_of_failure(std::future<v1::RenderGradReply> future) {
  try {
    future.get();
  } catch (const Error& error) {
    return error.kind();
  }
  ADD_FAILURE() << "no error";
  return ErrorKind::kInternal;
}

TEST(RenderPool, GivesTheSameBytesInEveryArrangement) {
  WorkerProcess a, b;
  RenderPool embedded(pool_of({}));
  RenderPool one(pool_of({a.address()}));
  RenderPool two(pool_of({a.address(), b.address()}));
  const auto all = jobs(12);
  const auto expected = render_all(embedded, all);
  EXPECT_EQ(render_all(one, all), expected);
  EXPECT_EQ(render_all(two, all), expected);
  SceneCache cache(size_t{64} << 20);
  LocalRenderer local(cache);
  EXPECT_EQ(render_all(local, all), expected);
  EXPECT_EQ(two.statistics().jobs, 12U);
  EXPECT_EQ(two.statistics().retries, 0U);
  EXPECT_GT(two.statistics().cpu_seconds, 0);
  EXPECT_EQ(two.parallelism(), 2 * one.parallelism());
}

// A job of several tiles.
RenderJob large_job() {
  RenderJob job;
  job.scene = serialize(cube_scene(50, 40));
  job.request = small_request(1024);
  job.request.mutable_material()->set_albedo(0.2);
  return job;
}

TEST(RenderPool, PutsASplitRenderTogetherBitForBit) {
  WorkerProcess a, b;
  RenderPool embedded(pool_of({}));
  RenderPool two(pool_of({a.address(), b.address()}));
  const RenderJob job = large_job();
  std::vector<double> fractions;
  EXPECT_EQ(deterministic_bytes(two.render_split(job, [&](double f) { fractions.push_back(f); })),
            deterministic_bytes(embedded.submit(job).get()));
  EXPECT_EQ(fractions.back(), 1);
  EXPECT_EQ(two.statistics().jobs, 9U);
}

TEST(RenderPool, SplitsSeveralRenders) {
  RenderPool pool(pool_of({}));
  std::vector<RenderJob> jobs(2, large_job());
  jobs[1].request.set_seed(jobs[0].request.seed() + 1);
  jobs[1].scene = serialize(cube_scene(16, 12));
  const std::vector<v1::RenderGradReply> replies = pool.render_split(jobs);
  ASSERT_EQ(replies.size(), 2U);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(deterministic_bytes(replies[i]), deterministic_bytes(pool.submit(jobs[i]).get()))
        << i;
  }
  EXPECT_TRUE(pool.render_split(std::span<const RenderJob>()).empty());
}

TEST(RenderPool, SplitsARenderWithAPilotTheSameForAnyNumberOfWorkers) {
  WorkerProcess a, b;
  RenderPool embedded(pool_of({}));
  RenderPool two(pool_of({a.address(), b.address()}));
  RenderJob job = large_job();
  job.request.set_pilot_spp(4);
  const v1::RenderGradReply reply = embedded.render_split(job);
  EXPECT_EQ(deterministic_bytes(two.render_split(job)), deterministic_bytes(reply));
  // The pilot of a tile needs little more than its own pixels.
  const double paths = 50 * 40 * (1024 + 4);
  EXPECT_NEAR(static_cast<double>(reply.counters().paths()), paths, 0.02 * paths);
}

TEST(RenderPool, SendsASceneOnlyToAWorkerThatDoesNotHoldIt) {
  WorkerProcess a, b;
  RenderPool pool_a(pool_of({a.address()}));
  const RenderJob job = jobs(1)[0];
  for (int i = 0; i < 3; ++i) pool_a.submit(job).get();
  EXPECT_EQ(pool_a.statistics().scenes_sent, 1U);
  RenderPool pool_b(pool_of({b.address()}));
  pool_b.submit(job).get();
  EXPECT_EQ(pool_b.statistics().scenes_sent, 1U);
  RenderPool again(pool_of({a.address()}));
  again.submit(job).get();
  EXPECT_EQ(again.statistics().scenes_sent, 0U);
}

TEST(RenderPool, SendsTheSceneAgainToAWorkerThatForgotIt) {
  WorkerProcess worker("127.0.0.1:0", {"--cache-mb", "0"});
  RenderPool pool(pool_of({worker.address()}));
  const auto two_scenes = jobs(2);
  for (int i = 0; i < 2; ++i) {
    for (const RenderJob& job : two_scenes) pool.submit(job).get();
  }
  EXPECT_EQ(pool.statistics().scenes_sent, 4U);
}

TEST(RenderPool, SurvivesAWorkerThatIsKilled) {
  auto doomed = std::make_unique<WorkerProcess>();
  WorkerProcess other;
  const auto all = jobs(16, 150);
  RenderPool embedded(pool_of({}));
  const auto expected = render_all(embedded, all);
  RenderPool pool(pool_of({doomed->address(), other.address()}));
  wait_until_both_render(pool);
  const uint64_t before = pool.statistics().jobs;
  std::thread killer([&] {
    while (pool.statistics().jobs < before + 4) std::this_thread::sleep_for(1ms);
    doomed->send(SIGKILL);
  });
  EXPECT_EQ(render_all(pool, all), expected);
  killer.join();
  EXPECT_GT(pool.statistics().retries, 0U);
}

TEST(RenderPool, SurvivesAWorkerThatDrains) {
  WorkerProcess doomed, other;
  const auto all = jobs(16, 150);
  RenderPool embedded(pool_of({}));
  const auto expected = render_all(embedded, all);
  RenderPool pool(pool_of({doomed.address(), other.address()}));
  wait_until_both_render(pool);
  const uint64_t before = pool.statistics().jobs;
  std::thread stopper([&] {
    while (pool.statistics().jobs < before + 4) std::this_thread::sleep_for(1ms);
    doomed.send(SIGTERM);
    EXPECT_EQ(doomed.wait(), 0);
  });
  EXPECT_EQ(render_all(pool, all), expected);
  stopper.join();
}

// SIGTERM at any moment: while renders arrive, wait, run, and are answered.
TEST(RenderPool, SurvivesWorkersThatDrainAgainAndAgain) {
  WorkerProcess steady;
  auto victim = std::make_unique<WorkerProcess>();
  const std::string address = victim->address();
  RenderPool pool(pool_of({address, steady.address()}));
  RenderPool embedded(pool_of({}));
  const auto all = jobs(24, 4);
  const auto expected = render_all(embedded, all);
  wait_until_both_render(pool);
  std::atomic<bool> done = false;
  std::thread stopper([&] {
    for (int round = 0; round < 12; ++round) {
      const uint64_t before = pool.statistics().jobs;
      if (!eventually([&] { return pool.statistics().jobs > before + 3; })) break;
      victim->send(SIGTERM);
      EXPECT_EQ(victim->wait(), 0);
      victim = std::make_unique<WorkerProcess>(address);
    }
    done = true;
  });
  while (!done) EXPECT_EQ(render_all(pool, all), expected);
  stopper.join();
}

TEST(RenderPool, SurvivesAWorkerThatHangs) {
  WorkerProcess hanging, other;
  RenderPool pool(pool_of({hanging.address(), other.address()}));
  wait_until_both_render(pool);
  hanging.send(SIGSTOP);
  RenderPool embedded(pool_of({}));
  const auto all = jobs(6);
  EXPECT_EQ(render_all(pool, all), render_all(embedded, all));
  EXPECT_GT(pool.statistics().retries + pool.statistics().hedges, 0U);
  hanging.send(SIGCONT);
}

TEST(RenderPool, NoticesThatItsOnlyWorkerHangs) {
  WorkerProcess worker;
  RenderPool pool(pool_of({worker.address()}));
  RenderPool embedded(pool_of({}));
  const auto all = jobs(2);
  const auto expected = render_all(embedded, all);
  EXPECT_EQ(render_all(pool, all), expected);
  worker.send(SIGSTOP);
  auto replies = std::async(std::launch::async, [&] { return render_all(pool, all); });
  EXPECT_TRUE(eventually([&] { return pool.statistics().retries > 0; }));  // 10 s by keepalive
  worker.send(SIGCONT);
  EXPECT_EQ(replies.get(), expected);
}

TEST(RenderPool, FindsAWorkerThatIsStartedAgain) {
  auto worker = std::make_unique<WorkerProcess>();
  const std::string address = worker->address();
  RenderPool pool(pool_of({address}));
  const auto all = jobs(2);
  const auto expected = render_all(pool, all);
  worker.reset();  // kills it
  const uint64_t before = pool.statistics().retries;
  auto replies = std::async(std::launch::async, [&] { return render_all(pool, all); });
  worker = std::make_unique<WorkerProcess>(address);
  EXPECT_EQ(replies.get(), expected);
  EXPECT_GE(pool.statistics().retries, before);
}

// Its cache is empty then.
TEST(RenderPool, SendsScenesAgainToAWorkerThatIsStartedAgain) {
  auto worker = std::make_unique<WorkerProcess>();
  const std::string address = worker->address();
  RenderPool pool(pool_of({address}));
  const auto all = jobs(3);  // of three scenes
  const auto expected = render_all(pool, all);
  EXPECT_EQ(pool.statistics().scenes_sent, 3U);
  worker.reset();  // kills it
  worker = std::make_unique<WorkerProcess>(address);
  EXPECT_EQ(render_all(pool, all), expected);
  EXPECT_EQ(pool.statistics().scenes_sent, 6U);
  EXPECT_EQ(pool.statistics().jobs, 6U);
}

TEST(RenderPool, WaitsUntilWorkersThatAreAllGoneAreBack) {
  auto a = std::make_unique<WorkerProcess>(), b = std::make_unique<WorkerProcess>();
  const std::string address_of_a = a->address(), address_of_b = b->address();
  RenderPool pool(pool_of({address_of_a, address_of_b}));
  RenderPool embedded(pool_of({}));
  const auto all = jobs(24, 150);
  const auto expected = render_all(embedded, all);
  wait_until_both_render(pool);
  const uint64_t before = pool.statistics().jobs;
  auto replies = std::async(std::launch::async, [&] { return render_all(pool, all); });
  ASSERT_TRUE(eventually([&] { return pool.statistics().jobs > before + 2; }));
  a.reset();
  b.reset();
  a = std::make_unique<WorkerProcess>(address_of_a);
  b = std::make_unique<WorkerProcess>(address_of_b);
  EXPECT_EQ(replies.get(), expected);
  EXPECT_EQ(pool.statistics().jobs, before + all.size());
  EXPECT_GT(pool.statistics().retries, 0U);
}

TEST(RenderPool, WaitsForPlaceInABusyWorker) {
  WorkerProcess worker("127.0.0.1:0", {"--queue", "0"});
  RenderPool pool(pool_of({worker.address()}));
  RenderPool embedded(pool_of({}));
  const auto all = jobs(5, 50);
  EXPECT_EQ(render_all(pool, all), render_all(embedded, all));
}

TEST(RenderPool, GivesUpARenderThatTakesTooLong) {
  auto options = pool_of({});
  options.deadline = 100ms;
  RenderPool pool(options);
  RenderJob job = jobs(1)[0];
  job.request = endless_request();
  try {
    pool.submit(job).get();
    FAIL() << "rendered";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUnavailable);
    EXPECT_THAT(error.what(),
                HasSubstr("was lost 3 times and is given up: the embedded worker: no answer "
                          "within 0.1 s;"));
  }
}

// One that workers never finish, on workers that can do one thing at a time. What waits behind it
// is not blamed, however long it waits.
TEST(RenderPool, GivesUpARenderThatStarvesItsWorkersAndRendersTheOthers) {
  WorkerProcess a, b;
  auto options = pool_of({a.address(), b.address()});
  options.deadline = 1500ms;
  RenderPool pool(options);
  wait_until_both_render(pool);
  const uint64_t before = pool.statistics().jobs;
  RenderJob poison = jobs(1)[0];
  poison.request = endless_request();
  const auto start = std::chrono::steady_clock::now();
  auto poisoned = pool.submit(poison);
  const auto all = jobs(24);
  RenderPool embedded(pool_of({}));
  EXPECT_EQ(render_all(pool, all), render_all(embedded, all));
  EXPECT_EQ(kind_of_failure(std::move(poisoned)), ErrorKind::kUnavailable);
  EXPECT_EQ(pool.statistics().jobs, before + all.size());
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  std::printf("  the others are rendered and the poison is given up after %.1f s: 3 x 1.5 s\n",
              took.count());
  EXPECT_EQ(render_all(pool, all), render_all(pool, all));  // by workers that are themselves again
}

TEST(RenderPool, NamesTheWorkersIfNoneAnswers) {
  auto options = pool_of({"127.0.0.1:1", "127.0.0.1:2"});
  options.connect_within = 500ms;
  try {
    const RenderPool pool(options);
    FAIL() << "connected";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUnavailable);
    EXPECT_THAT(error.what(), HasSubstr("127.0.0.1:1"));
    EXPECT_THAT(error.what(), HasSubstr("127.0.0.1:2"));
  }
}

TEST(RenderPool, CancelsWhatIsUnderWayWhenItGoesAway) {
  WorkerProcess worker;
  for (const auto& workers : {std::vector<std::string>{}, {worker.address()}}) {
    auto pool = std::make_unique<RenderPool>(pool_of(workers));
    RenderJob job = jobs(1)[0];
    job.request = endless_request();
    std::list<std::future<v1::RenderGradReply>> futures;
    const double before = workers.empty() ? own_cpu_seconds() : worker.cpu_seconds();
    for (int i = 0; i < 4; ++i) futures.push_back(pool->submit(job));
    // What takes days is being rendered when a tenth of a second has been spent on it.
    ASSERT_TRUE(eventually([&] {
      return (workers.empty() ? own_cpu_seconds() : worker.cpu_seconds()) > before + 0.1;
    }));
    pool.reset();
    for (auto& future : futures) {
      EXPECT_EQ(kind_of_failure(std::move(future)), ErrorKind::kCancelled);
    }
  }
}

}  // namespace
}  // namespace itn
