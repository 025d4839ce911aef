// How well the render pool keeps many workers busy, and what that costs. The workers are fakes
// behind the pool's own seam: each renders one job after the other, in times drawn from a
// distribution like that of measured ones, and otherwise sleeps. All else is what itn runs.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <random>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "client/render_pool/dispatcher.h"
#include "client/render_pool/render_pool.h"
#include "client/render_pool/render_worker.h"
#include "common/flags.h"
#include "tests/support/cpu_time.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr double kSlowFactor = 10;

struct Flags {
  int workers = 256;
  int jobs = 0;
  double median_ms = 20;
  double sigma = 0.5;
  double slow_fraction = 0.01;
};

// All renders of all workers.
class Times {
 public:
  explicit Times(const Flags& flags) : flags_(flags) {}

  Clock::duration draw(std::mt19937& random) const {
    double ms =
        std::lognormal_distribution<double>(std::log(flags_.median_ms), flags_.sigma)(random);
    if (std::bernoulli_distribution(flags_.slow_fraction)(random)) ms *= kSlowFactor;
    return std::chrono::duration_cast<Clock::duration>(Seconds(ms / 1000));
  }

  // When the last render was handed out, all workers had something to do until then.
  void begun() {
    if (++begun_ == flags_.jobs) last_begun_ = Clock::now();
  }
  Clock::time_point last_begun() const { return last_begun_; }

 private:
  const Flags flags_;
  std::atomic<int> begun_ = 0;
  std::atomic<Clock::time_point> last_begun_{};
};

struct Interval {
  Clock::time_point begin, end;
};

class SleepingWorker final : public RenderWorker {
 public:
  SleepingWorker(Times& times, unsigned seed, std::atomic<int>& up)
      : times_(times), up_(up), random_(seed) {}

  grpc::Status probe(bool /*patient*/, const std::stop_token& /*stop*/,
                     v1::Capabilities& /*capabilities*/) override {
    ++up_;
    return grpc::Status::OK;
  }

  // Renders as a worker with a queue does: the next render begins when the one before it ends,
  // whenever the thread that asked for it wakes.
  Answer render(const RenderJob& job, std::chrono::milliseconds /*deadline*/,
                const std::stop_token& stop) override {
    times_.begun();
    std::unique_lock lock(mutex_);
    const Clock::time_point begin = std::max(free_at_, Clock::now());
    free_at_ = begin + times_.draw(random_);
    rendered_.push_back({begin, free_at_});
    const Clock::time_point end = free_at_;
    wait_.wait_until(lock, stop, end, [] { return false; });
    if (stop.stop_requested()) {
      return {.outcome = Outcome::kUnreachable, .status = grpc::Status::CANCELLED, .reply = {}};
    }
    Answer answer{.outcome = Outcome::kAnswered, .status = {}, .reply = {}};
    answer.reply.set_loss(static_cast<double>(job.request.seed()));
    return answer;
  }

  double busy_seconds(Clock::time_point from, Clock::time_point to) const {
    double seconds = 0;
    for (const Interval& render : rendered_) {
      const Seconds within = std::min(render.end, to) - std::max(render.begin, from);
      seconds += std::max(within.count(), 0.0);
    }
    return seconds;
  }

 private:
  Times& times_;
  std::atomic<int>& up_;
  std::mutex mutex_;
  std::condition_variable_any wait_;
  std::mt19937 random_;
  Clock::time_point free_at_{};
  std::vector<Interval> rendered_;
};

RenderJob job_of(const std::shared_ptr<const SerializedScene>& scene, uint64_t seed) {
  RenderJob job;
  job.scene = scene;
  job.request = testing::small_request();
  job.request.set_seed(seed);
  return job;
}

// Microseconds of processor time for one render's decisions (submit, next, finish), each worker
// having two renders under way and as many more waiting.
double decision_microseconds(int workers, int jobs) {
  Dispatcher dispatcher(std::chrono::seconds(30));
  const auto scene = serialize(testing::cube_scene());
  const auto now = Clock::now();
  std::vector<std::shared_ptr<Dispatcher::Attempt>> under_way;
  for (int i = 0; i < workers; ++i) {
    dispatcher.on_probe(dispatcher.add(std::to_string(i)), grpc::Status::OK, {}, now);
  }
  const auto count = static_cast<size_t>(workers);
  std::vector<std::future<v1::RenderGradReply>> futures;
  for (size_t i = 0; i < 4 * count; ++i)
    futures.push_back(dispatcher.submit(job_of(scene, i), now));
  for (size_t i = 0; i < 2 * count; ++i) {
    under_way.push_back(dispatcher.next(i % count, now).attempt);
  }
  std::vector<RenderJob> more;
  for (int i = 0; i < jobs; ++i) more.push_back(job_of(scene, static_cast<uint64_t>(i)));
  const double before = testing::own_cpu_seconds();
  for (size_t i = 0; i < more.size(); ++i) {
    auto& attempt = under_way[i % under_way.size()];
    const size_t worker = attempt->worker;
    dispatcher.finish(attempt, {.outcome = Outcome::kAnswered, .status = {}, .reply = {}}, now);
    futures.push_back(dispatcher.submit(std::move(more[i]), now));
    attempt = dispatcher.next(worker, now).attempt;
  }
  return 1e6 * (testing::own_cpu_seconds() - before) / jobs;
}

void run(Flags flags) {
  if (flags.jobs == 0) flags.jobs = 100 * flags.workers;
  Times times(flags);
  std::atomic<int> up = 0;
  std::vector<SleepingWorker*> workers;
  RenderPoolOptions options;
  for (int i = 0; i < flags.workers; ++i) options.workers.push_back(fmt::format("fake:{}", i + 1));
  options.connect = [&](const std::string& /*address*/) {
    auto worker = std::make_unique<SleepingWorker>(times, workers.size(), up);
    workers.push_back(worker.get());
    return worker;
  };
  RenderPool pool(options);
  while (up < flags.workers) std::this_thread::sleep_for(std::chrono::milliseconds(1));

  const auto scene = serialize(testing::cube_scene());
  std::vector<RenderJob> jobs;
  for (int i = 0; i < flags.jobs; ++i) jobs.push_back(job_of(scene, static_cast<uint64_t>(i)));
  std::vector<std::future<v1::RenderGradReply>> futures;
  const auto begin = Clock::now();
  const double cpu_before = testing::own_cpu_seconds();
  for (RenderJob& job : jobs) futures.push_back(pool.submit(std::move(job)));
  int wrong = 0;
  for (size_t i = 0; i < futures.size(); ++i) {
    if (futures[i].get().loss() != static_cast<double>(i)) ++wrong;
  }
  const double cpu = testing::own_cpu_seconds() - cpu_before;
  const double seconds = Seconds(Clock::now() - begin).count();

  const double window = Seconds(times.last_begun() - begin).count();
  double busy = 0;
  for (const SleepingWorker* worker : workers)
    busy += worker->busy_seconds(begin, times.last_begun());
  const RenderStatistics statistics = pool.statistics();
  fmt::print(
      "{} workers, {} renders: utilisation {:.1f} % while any waited ({:.2f} of {:.2f} s), {:.0f} "
      "renders/s, {:.1f} us of processor time each, {} wrong, {} second attempts, {} retries\n",
      flags.workers, flags.jobs, 100 * busy / (window * flags.workers), window, seconds,
      flags.jobs / seconds, 1e6 * cpu / flags.jobs, wrong, statistics.hedges, statistics.retries);
  fmt::print("the dispatcher's decisions alone: {:.2f} us for each render\n",
             decision_microseconds(flags.workers, 100000));
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::Flags flags;
  CLI::App app("Fake workers through the real dispatcher", "dispatch_bench");
  app.add_option("--workers", flags.workers, "How many")
      ->check(itn::number_in(1, 4096))
      ->capture_default_str();
  app.add_option("--jobs", flags.jobs, "Renders; 0: a hundred for each worker")
      ->check(itn::number_in(0, 10000000))
      ->capture_default_str();
  app.add_option("--median-ms", flags.median_ms, "Median of the log-normal time of a render")
      ->check(itn::number_in(0.1, 10000.0))
      ->capture_default_str();
  app.add_option("--sigma", flags.sigma, "Standard deviation of its logarithm")
      ->check(itn::number_in(0.0, 3.0))
      ->capture_default_str();
  app.add_option("--slow", flags.slow_fraction, "Fraction of renders that take ten times as long")
      ->check(itn::number_in(0.0, 1.0))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  itn::run(flags);
}
