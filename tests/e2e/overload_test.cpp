// A worker that is asked for twice what it can do: it goes on doing almost as much as it can, tells
// those whom it sends away when to come back, and stays within its memory. ITN_OVERLOAD_SECONDS
// sets how long.
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/render_pool/outcome.h"
#include "itn/v1/render.grpc.pb.h"
#include "tests/support/paths.h"
#include "tests/support/scenes.h"
#include "tests/support/server_process.h"
#include "tests/support/statistics.h"

namespace itn::testing {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr int kClients = 4;
constexpr double kSecondsOfARender = 0.02;
constexpr double kMemoryMegabytes = 512;
constexpr double kMinOfCapacity = 0.8;

double seconds_of_overload() {
  const char* wanted = std::getenv("ITN_OVERLOAD_SECONDS");
  return wanted != nullptr ? std::atof(wanted) : 12;
}

struct Answer {
  grpc::Status status;
  double at = 0;    // seconds since the start of the load
  double took = 0;  // seconds
};

// A client with a connection of its own.
struct Client {
  explicit Client(const std::string& address) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    stub = v1::RenderService::NewStub(
        grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
  }
  std::unique_ptr<v1::RenderService::Stub> stub;
};

// What is asked for, again and again, by several clients, and what came of it.
class Load {
 public:
  Load(std::vector<Client>& clients, v1::RenderGradRequest request)
      : clients_(clients), request_(std::move(request)) {}

  // Each client asks again when it has been answered.
  std::vector<Answer> closed(double seconds) {
    return run(seconds, [&](Client& client, unsigned, const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        const size_t number = begin(client);
        std::unique_lock lock(mutex_);
        answered_.wait(lock, [&] { return calls_[number]->done; });
      }
    });
  }

  // All clients together ask for twice as many renders as were answered lately, whatever the
  // answers are: at random times, independent of each other (a Poisson process). `least`: a second,
  // for a start.
  std::vector<Answer> twice_its_capacity(double seconds, double least) {
    return run(seconds, [&, least](Client& client, unsigned seed, const std::stop_token& stop) {
      std::mt19937 random(seed);
      auto next = Clock::now();
      while (!stop.stop_requested()) {
        std::exponential_distribution<double> pause(std::max(least, 2 * served_lately()) /
                                                    kClients);
        next += std::chrono::duration_cast<Clock::duration>(Seconds(pause(random)));
        std::this_thread::sleep_until(next);
        begin(client);
      }
    });
  }

 private:
  struct Call {
    grpc::ClientContext context;
    v1::RenderGradReply reply;
    Clock::time_point begun;
    Answer answer;
    bool done = false;
  };

  // A second.
  double served_lately() {
    constexpr Seconds kLately{2};
    const std::lock_guard lock(mutex_);
    while (!served_.empty() && Clock::now() - served_.front() > kLately) served_.pop_front();
    return static_cast<double>(served_.size()) / kLately.count();
  }

  size_t begin(Client& client) {
    auto call = std::make_unique<Call>();
    Call& c = *call;
    c.begun = Clock::now();
    size_t number = 0;
    {
      const std::lock_guard lock(mutex_);
      number = calls_.size();
      calls_.push_back(std::move(call));
      ++under_way_;
    }
    client.stub->async()->RenderGrad(&c.context, &request_, &c.reply, [this, &c](grpc::Status s) {
      const std::lock_guard lock(mutex_);
      c.answer = {std::move(s), Seconds(Clock::now() - start_).count(),
                  Seconds(Clock::now() - c.begun).count()};
      c.done = true;
      if (c.answer.status.ok()) served_.push_back(Clock::now());
      c.reply.Clear();
      --under_way_;
      answered_.notify_all();
    });
    return number;
  }

  template <typename Ask>
  std::vector<Answer> run(double seconds, const Ask& ask) {
    calls_.clear();
    start_ = Clock::now();
    {
      std::vector<std::jthread> threads;
      for (unsigned i = 0; i < clients_.size(); ++i) {
        threads.emplace_back([&, i](const std::stop_token& stop) { ask(clients_[i], i, stop); });
      }
      std::this_thread::sleep_for(Seconds(seconds));  // the load lasts that long
    }
    std::unique_lock lock(mutex_);
    answered_.wait(lock, [&] { return under_way_ == 0; });
    std::vector<Answer> answers;
    for (const auto& call : calls_) answers.push_back(call->answer);
    return answers;
  }

  std::vector<Client>& clients_;
  const v1::RenderGradRequest request_;
  std::mutex mutex_;
  std::condition_variable answered_;
  std::vector<std::unique_ptr<Call>> calls_;
  std::deque<Clock::time_point> served_;
  size_t under_way_ = 0;
  Clock::time_point start_;
};

// Renders a second, by seconds.
Estimated rate(const std::vector<Answer>& answers, double seconds) {
  std::vector<double> counts(static_cast<size_t>(seconds));
  for (const Answer& answer : answers) {
    const auto second = static_cast<size_t>(answer.at);
    if (answer.status.ok() && second < counts.size()) ++counts[second];
  }
  return over_batches(counts);
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::ranges::sort(values);
  return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1))];
}

// Processor time of the worker for each render that it answers while it does nothing in vain.
struct Cost {
  double cpu_seconds = 0;
  double per_second = 0;  // renders that were answered
};
Cost cost_of_a_render(Load& load, const ServerProcess& worker, double seconds) {
  const double before = worker.cpu_seconds();
  const auto answers = load.closed(seconds);
  const auto served = std::ranges::count_if(answers, [](const auto& a) { return a.status.ok(); });
  const Estimated per_second = rate(answers, seconds);
  std::printf("  %.1f +- %.1f renders/s of clients that wait for their answers\n", per_second.mean,
              per_second.standard_error);
  return {(worker.cpu_seconds() - before) / static_cast<double>(served), per_second.mean};
}

// The seconds of the thread that had the most to do since then.
double most_with_work(const ServerProcess& worker, std::map<std::string, double> before) {
  double most = 0;
  for (const auto& [thread, seconds] : worker.seconds_with_work()) {
    most = std::max(most, seconds - before[thread]);
  }
  return most;
}

// Neighbours on the machine take processor time from the worker: what it can do is said by the time
// that a render takes of a processor, and by how much of the time it has something to render,
// whether it gets a processor for it or not.
TEST(Overload, OfTwiceItsCapacityLeavesAWorkerMostOfIt) {
  const ServerProcess worker(testing::kItnWorker, {"--threads", "1", "--max-memory-mb",
                                                   std::to_string(int(kMemoryMegabytes))});
  std::vector<Client> clients;
  for (int i = 0; i < kClients; ++i) clients.emplace_back(worker.address());

  v1::RenderGradRequest request = small_request(64);
  request.set_scene(cube_scene(32, 24).SerializeAsString());
  const double seconds = seconds_of_overload();
  const double before_seconds = std::max(3.0, seconds / 6);
  {  // A render of the time that is wanted.
    Load trial(clients, request);
    const double cpu = cost_of_a_render(trial, worker, 2).cpu_seconds;
    request.set_spp(static_cast<uint32_t>(std::clamp(64 * kSecondsOfARender / cpu, 2.0, 1e5)));
  }
  Load load(clients, request);
  const Cost before = cost_of_a_render(load, worker, before_seconds);
  ASSERT_GT(before.per_second, 0);
  const double resident_before = worker.resident_bytes();

  std::atomic<double> peak = 0;
  std::jthread watch([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      peak = std::max<double>(peak, worker.resident_bytes());
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const auto start = Clock::now();
  const double cpu_start = worker.cpu_seconds();
  const auto work_start = worker.seconds_with_work();
  const std::vector<Answer> answers = load.twice_its_capacity(seconds, before.per_second / 2);
  const double with_work =
      most_with_work(worker, work_start) / Seconds(Clock::now() - start).count();
  const double cpu_used = worker.cpu_seconds() - cpu_start;
  watch = {};
  const Estimated during = rate(answers, seconds);

  std::vector<double> served, refused, hints;
  size_t others = 0, without_hint = 0;
  for (const Answer& answer : answers) {
    const auto code = answer.status.error_code();
    if (code == grpc::OK) {
      served.push_back(answer.took);
    } else if (code == grpc::UNAVAILABLE || code == grpc::RESOURCE_EXHAUSTED) {
      refused.push_back(answer.took);
      const auto hint = retry_after(answer.status);
      hint ? hints.push_back(Seconds(*hint).count()) : void(++without_hint);
    } else {
      ++others;
      ADD_FAILURE() << code << ": " << answer.status.error_message();
    }
  }
  const double cpu_during = cpu_used / static_cast<double>(served.size());
  const double part = before.cpu_seconds / cpu_during * with_work;
  std::printf("  asked for %.1f/s for %.0f s; served %.1f +- %.1f/s\n",
              static_cast<double>(answers.size()) / seconds, seconds, during.mean,
              during.standard_error);
  std::printf(
      "  %.1f ms of a processor for each render, %.1f under overload; had work for %.1f %% of the "
      "time: %.1f %% of its capacity\n",
      1000 * before.cpu_seconds, 1000 * cpu_during, 100 * with_work, 100 * part);
  std::printf("  answers after %.2f s (p50), %.2f s (p99)\n", quantile(served, 0.5),
              quantile(served, 0.99));
  std::printf(
      "  refused %zu after %.1f ms (p50), %.1f ms (p99); to come again after %.2f to %.2f s\n",
      refused.size(), 1000 * quantile(refused, 0.5), 1000 * quantile(refused, 0.99),
      quantile(hints, 0), quantile(hints, 1));
  std::printf("  memory %.0f MiB before, %.0f MiB at most, of %.0f\n", resident_before / (1 << 20),
              peak / (1 << 20), kMemoryMegabytes);

  EXPECT_EQ(others, 0U);
  EXPECT_EQ(without_hint, 0U) << "refused without a time to come again";
  EXPECT_GT(refused.size(), answers.size() / 4) << "this was no overload";
  EXPECT_LT(peak, kMemoryMegabytes * (1 << 20));
  EXPECT_GT(part, kMinOfCapacity);
}

}  // namespace
}  // namespace itn::testing
