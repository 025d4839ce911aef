// Mixed calls to a worker and to a predictor, thousands of them: good ones of several sizes, some
// that are cancelled or late, bad ones, and questions about health, over connections
// that come and go. What is allocated, file descriptors and threads do not grow, and equal requests
// get equal bytes, at the end as at the beginning. Resident memory has a loose limit: it moves in
// steps of the heap, the later the fewer, which no line tells from a leak in a few minutes.
// ITN_SOAK_CALLS sets how many calls each server gets.
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/rpc/deadline.h"
#include "common/rpc/status.h"
#include "itn/v1/predict.grpc.pb.h"
#include "itn/v1/render.grpc.pb.h"
#include "tests/support/disc_image.h"
#include "tests/support/health.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scenes.h"
#include "tests/support/server_process.h"
#include "tests/support/statistics.h"
#include "tests/support/temporary_folder.h"

namespace itn::testing {
namespace {

using namespace std::chrono_literals;
using Random = std::mt19937;
using Channel = std::shared_ptr<grpc::Channel>;

constexpr int kClients = 4;
constexpr int kCallsOfAClient = 10;  // between two looks at the server, over one connection

int calls_of_a_soak() {
  const char* wanted = std::getenv("ITN_SOAK_CALLS");
  return wanted != nullptr ? std::atoi(wanted) : 3000;
}

size_t one_of(Random& random, size_t count) {
  return std::uniform_int_distribution<size_t>(0, count - 1)(random);
}

// What came of all calls. Thread-safe.
class Outcomes {
 public:
  // `kind`: of the call; `expected`: the only status, or empty for any.
  void add(const std::string& kind, const grpc::Status& status, const std::string& expected) {
    const std::lock_guard lock(mutex_);
    ++counts_[kind + ": " + status_name(status.error_code())];
    if (!expected.empty() && status_name(status.error_code()) != expected && ++reported_ < 10) {
      ADD_FAILURE() << kind << ": " << status_name(status.error_code()) << " ("
                    << status.error_message() << ") rather than " << expected;
    }
  }

  // That equal requests have equal answers.
  void add_answer(const std::string& request, const std::string& answer) {
    const std::lock_guard lock(mutex_);
    const auto [there, is_new] = answers_.try_emplace(request, answer);
    if (!is_new && there->second != answer && ++reported_ < 10) {
      ADD_FAILURE() << "another answer to " << request;
    }
  }

  int print() const {
    int all = 0;
    for (const auto& [what, count] : counts_) {
      std::printf("  %6d %s\n", count, what.c_str());
      all += count;
    }
    std::printf("  %6zu different requests were answered the same each time\n", answers_.size());
    return all;
  }

 private:
  std::mutex mutex_;
  std::map<std::string, int> counts_;
  std::map<std::string, std::string> answers_;
  int reported_ = 0;
};

// Calls by gRPC's asynchronous interface, so that it can be cancelled.
template <typename Begin>
grpc::Status call(grpc::ClientContext& context, const Begin& begin,
                  std::chrono::microseconds cancel_after = {}) {
  std::promise<grpc::Status> done;
  begin([&](grpc::Status status) { done.set_value(std::move(status)); });
  auto status = done.get_future();
  if (cancel_after > 0us && status.wait_for(cancel_after) != std::future_status::ready) {
    context.TryCancel();
  }
  return status.get();
}

// ---- A worker ----------------------------------------------------------------------------------

// One of a few dozen, so that scenes come again, and more than the cache holds.
v1::RenderGradRequest some_render(Random& random) {
  static const std::vector<std::pair<int, int>> sizes = {{8, 8}, {16, 12}, {40, 30}, {64, 64}};
  const auto [width, height] = sizes[one_of(random, sizes.size())];
  v1::Scene scene = cube_scene(width, height);
  // The distance of the ground makes it another scene.
  scene.mutable_camera()->mutable_origin()->set_y(1.5F +
                                                  0.1F * static_cast<float>(one_of(random, 8)));
  v1::RenderGradRequest request = small_request(2 + static_cast<uint32_t>(one_of(random, 3)));
  request.set_scene(scene.SerializeAsString());
  return request;
}

// What makes a good request a bad one, and the status that says so.
template <typename Request>
using Faults = std::vector<std::pair<std::function<void(Request&)>, std::string>>;

template <typename Request>
std::pair<Request, std::string> spoiled(Request request, const Faults<Request>& faults,
                                        Random& random) {
  const auto& [spoil, status] = faults[one_of(random, faults.size())];
  spoil(request);
  return {request, status};
}

const Faults<v1::RenderGradRequest> kBadRenders = {
    {[](auto& r) { r.set_scene("this is no scene"); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_scene(cube_scene(0, 10).SerializeAsString()); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_scene(cube_scene(40000, 40000).SerializeAsString()); },
     "RESOURCE_EXHAUSTED"},
    {[](auto& r) { r.mutable_material()->set_albedo(1.5); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_spp(0); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_spp(1U << 30); }, "INVALID_ARGUMENT"},
    {[](auto& r) {
       r.clear_scene();
       r.set_scene_digest(std::string(32, 'x'));
     },
     "FAILED_PRECONDITION"},
};

void call_worker(const Channel& channel, Random& random, Outcomes& outcomes) {
  const auto stub = v1::RenderService::NewStub(channel);
  grpc::ClientContext context;
  v1::RenderGradReply reply;
  const auto render = [&](const v1::RenderGradRequest& request,
                          std::chrono::microseconds cancel_after = {}) {
    return call(
        context, [&](auto done) { stub->async()->RenderGrad(&context, &request, &reply, done); },
        cancel_after);
  };
  const size_t kind = one_of(random, 100);
  if (kind < 50) {
    const v1::RenderGradRequest request = some_render(random);
    const grpc::Status status = render(request);
    outcomes.add("render", status, "OK");
    if (status.ok()) outcomes.add_answer(request.SerializeAsString(), deterministic_bytes(reply));
  } else if (kind < 60) {
    v1::RenderGradRequest request = some_render(random);
    request.set_spp(100'000);
    outcomes.add("render that is cancelled", render(request, 1us + one_of(random, 20'000) * 1us),
                 "CANCELLED");
  } else if (kind < 65) {
    v1::RenderGradRequest request = some_render(random);
    request.set_spp(100'000);
    context.set_deadline(deadline_in(
        0.001 * std::chrono::duration<double>(static_cast<double>(1 + one_of(random, 20)))));
    outcomes.add("render with a deadline", render(request), "DEADLINE_EXCEEDED");
  } else if (kind < 80) {
    const auto [request, expected] = spoiled(some_render(random), kBadRenders, random);
    outcomes.add("bad render", render(request), expected);
  } else if (kind < 85) {
    v1::Capabilities capabilities;
    outcomes.add("capabilities", stub->GetCapabilities(&context, {}, &capabilities), "OK");
  } else {
    outcomes.add("health", health(channel, "itn.v1.RenderService").first, "OK");
  }
}

// ---- A predictor -------------------------------------------------------------------------------

v1::PredictRequest some_image(Random& random) {
  static const std::vector<int> sides = {32, 64, 128, 200};
  return disc_image(sides[one_of(random, sides.size())],
                    0.2 * static_cast<double>(one_of(random, 4)));
}

const Faults<v1::PredictRequest> kBadImages = {
    {[](auto& r) { r.clear_mask(); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_image("short"); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_width(0); }, "INVALID_ARGUMENT"},
    {[](auto& r) { r.set_model("unheard-of"); }, "NOT_FOUND"},
};

void call_predictor(const Channel& channel, Random& random, Outcomes& outcomes) {
  const auto stub = v1::PredictService::NewStub(channel);
  grpc::ClientContext context;
  v1::PredictReply reply;
  const auto predict = [&](const v1::PredictRequest& request,
                           std::chrono::microseconds cancel_after = {}) {
    return call(
        context, [&](auto done) { stub->async()->Predict(&context, &request, &reply, done); },
        cancel_after);
  };
  const size_t kind = one_of(random, 100);
  if (kind < 50) {
    const v1::PredictRequest request = some_image(random);
    const grpc::Status status = predict(request);
    outcomes.add("image", status, "OK");
    if (status.ok()) outcomes.add_answer(request.SerializeAsString(), reply.SerializeAsString());
  } else if (kind < 65) {
    // It may be answered before.
    outcomes.add("image that is cancelled",
                 predict(some_image(random), 1us + one_of(random, 5000) * 1us), "");
  } else if (kind < 80) {
    const auto [request, expected] = spoiled(some_image(random), kBadImages, random);
    outcomes.add("bad image", predict(request), expected);
  } else if (kind < 85) {
    v1::ListModelsReply models;
    outcomes.add("models", stub->ListModels(&context, {}, &models), "OK");
  } else {
    outcomes.add("health", health(channel, "itn.v1.PredictService").first, "OK");
  }
}

// ---- The soak ----------------------------------------------------------------------------------

using Caller = void (*)(const Channel& channel, Random& random, Outcomes& outcomes);

// Values of one resource, at each look.
struct Series {
  const char* name;
  double unit;
  std::vector<double> values;

  // That it did not grow, but for noise.
  void expect_level(int calls_between) const {
    const Estimated found = fitted_slope(values);
    const double scale = 1000.0 / calls_between / unit;
    const double steady =
        found.mean > 0 ? HUGE_VAL : 0;  // the same at each look, or exactly a line
    const double t = found.standard_error > 0 ? found.mean / found.standard_error : steady;
    std::printf("  %-16s %9.2f at first, %9.2f at last, %+.4f +- %.4f in 1000 calls, t = %+.2f\n",
                name, values.front() / unit, values.back() / unit, found.mean * scale,
                found.standard_error * scale, t);
    EXPECT_LT(t, t_threshold(3, found.degrees_of_freedom)) << name << " grows";
  }
};

// A connection of its own.
Channel connect_to(const ServerProcess& server) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(server.address(), grpc::InsecureChannelCredentials(), arguments);
}

// A metric of the server's --metrics-file.
double metric(const std::string& path, const std::string& name) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with(name + "{")) return std::stod(line.substr(line.rfind(' ')));
  }
  ADD_FAILURE() << path << " has no " << name;
  return 0;
}

// What the server says that it has allocated from now on.
double allocated_bytes(const std::string& metrics) {
  const double before = metric(metrics, "itn_uptime_seconds");
  EXPECT_TRUE(eventually([&] { return metric(metrics, "itn_uptime_seconds") > before; }));
  return metric(metrics, "itn_allocated_memory_bytes");
}

void soak(const std::string& program, std::vector<std::string> flags, Caller caller) {
  const TemporaryFolder folder;
  const std::string metrics = folder.path("itn.prom");
  flags.insert(flags.end(),
               {"--threads", "1", "--metrics-file", metrics, "--metrics-seconds", "1"});
  // What threads keep for themselves of freed memory counts as allocated, and fills for hours.
  ::setenv("GLIBC_TUNABLES", "glibc.malloc.tcache_count=0", 1);
  const ServerProcess server(program, flags);
  ::unsetenv("GLIBC_TUNABLES");
  {  // A server knows its latest thousand clients: those whose calls were work, which most are.
    Outcomes ignored;
    Random random(0);
    for (int i = 0; i < 2500; ++i) caller(connect_to(server), random, ignored);
  }
  Outcomes outcomes;
  Series allocated{"allocated, MiB", 1 << 20, {}}, descriptors{"descriptors", 1, {}},
      threads{"threads", 1, {}};
  double resident_at_first = 0;
  const int looks = calls_of_a_soak() / (kClients * kCallsOfAClient);
  const int warm_up = looks / 3;  // caches fill, heaps reach their size
  for (int look = 0; look < looks; ++look) {
    {
      std::vector<std::jthread> clients;
      for (int client = 0; client < kClients; ++client) {
        clients.emplace_back([&, client] {
          Random random(static_cast<unsigned>(look * kClients + client));
          const Channel channel = connect_to(server);
          for (int i = 0; i < kCallsOfAClient; ++i) caller(channel, random, outcomes);
        });
      }
    }
    if (look < warm_up) continue;
    const double bytes = allocated_bytes(metrics);
    ASSERT_GT(bytes, 1 << 20);
    if (look == warm_up) resident_at_first = server.resident_bytes();
    allocated.values.push_back(bytes);
    descriptors.values.push_back(server.descriptors());
    threads.values.push_back(server.threads());
  }
  const int all = outcomes.print();
  EXPECT_EQ(all, looks * kClients * kCallsOfAClient);  // none is missing, none counted twice
  std::printf("  %d calls; of those after the first third:\n", all);
  std::printf("  %-16s %9.2f at first, %9.2f at last\n", "resident, MiB",
              resident_at_first / (1 << 20), server.resident_bytes() / (1 << 20));
  EXPECT_LT(server.resident_bytes(), 1.5 * resident_at_first);
  for (const Series& series : {allocated, descriptors, threads}) {
    series.expect_level(kClients * kCallsOfAClient);
  }
}

TEST(Soak, OfAWorker) {
  soak(testing::kItnWorker, {"--cache-mb", "8"}, call_worker);
}

TEST(Soak, OfAPredictor) {
  soak(testing::kItnPredictor, {"--model", testing::source("models/any.itn")}, call_predictor);
}

}  // namespace
}  // namespace itn::testing
