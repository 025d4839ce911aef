// predict_bench: how long a predictor takes over RPC: clients that each ask for one image after the
// other, and one that sends batches. On a machine that does other things too, CPU time tells more
// than the clock.
#include <fmt/format.h>
#include <grpcpp/create_channel.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "common/learning/checkpoint.h"
#include "common/learning/network_input.h"
#include "common/learning/parameterization.h"
#include "common/passive_waiting.h"
#include "itn/v1/predict.grpc.pb.h"
#include "server/predict/predict_server.h"
#include "tests/support/cpu_time.h"
#include "tests/support/disc_image.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

struct Options {
  std::string model;
  std::string predictor;
  uint32_t base_channels = 24;
  uint32_t resolution = 64;
  std::vector<int> sides{64, 128};
  int batch = 64;
  std::vector<int> clients{1};
  int max_batch = 16;
  int threads = 2;
  double seconds = 5;
};

// A residual network that answers distributions, of random weights.
v1::Model random_model(const Options& options) {
  v1::Model model;
  model.set_name("random");
  model.set_resolution(options.resolution);
  auto& layers = *model.mutable_architecture()->mutable_residual_convolutions();
  layers.set_base_channels(options.base_channels);
  layers.set_blocks(1);
  model.set_output(v1::GAUSSIAN);
  model.set_parameterization(v1::UNBOUNDED);
  model.set_input(v1::RATIOS);
  model.set_exposure(v1::EXPOSURE_KNOWN);
  model.set_image_scale(1);
  const auto set = [](v1::Interval& interval, double min, double max) {
    interval.set_min(min);
    interval.set_max(max);
  };
  set(*model.mutable_bounds()->mutable_sigma_t(), 20, 300);
  set(*model.mutable_bounds()->mutable_albedo(), 0.35, 0.97);
  set(*model.mutable_bounds()->mutable_g(), -0.1, 0.9);
  const MaterialCoordinates mean =
      to_coordinates(v1::UNBOUNDED, {100, 0.7, 0.4}, g_interval(model.bounds()));
  for (const double m : mean) {
    model.add_mean(m);
    model.add_standard_deviation(0.7);
  }
  store_weights(*new_encoder(model), model);
  return model;
}

void require_ok(const grpc::Status& status) {
  if (!status.ok()) throw std::runtime_error(status.error_message());
}

// Milliseconds of each call, and the CPU time of this process for all of them.
struct Times {
  std::vector<double> milliseconds;
  double cpu_seconds = 0;
  double seconds = 0;  // from the first call to the end of the last

  double quantile(double q) const {
    return milliseconds[static_cast<size_t>(q * static_cast<double>(milliseconds.size() - 1))];
  }
};

// Measures `clients` threads that call again as soon as they are answered.
Times measure(double seconds, int clients, const std::function<void()>& call) {
  using Clock = std::chrono::steady_clock;
  for (int i = 0; i < 5; ++i) call();
  std::vector<Times> of_clients(static_cast<size_t>(clients));
  const double cpu = testing::own_cpu_seconds();
  const auto start = Clock::now();
  const auto since = [](Clock::time_point time) {
    return std::chrono::duration<double>(Clock::now() - time).count();
  };
  {
    std::vector<std::jthread> threads;
    for (Times& own : of_clients) {
      threads.emplace_back([&] {
        while (since(start) < seconds) {
          const auto begin = Clock::now();
          call();
          own.milliseconds.push_back(1000 * since(begin));
        }
      });
    }
  }
  Times times;
  times.seconds = since(start);
  times.cpu_seconds = testing::own_cpu_seconds() - cpu;
  for (const Times& own : of_clients) {
    times.milliseconds.insert(times.milliseconds.end(), own.milliseconds.begin(),
                              own.milliseconds.end());
  }
  std::ranges::sort(times.milliseconds);
  return times;
}

void bench(const Options& options, v1::PredictService::Stub& stub) {
  fmt::print("{:>9}  {:>7}  {:>6}  {:>10}  {:>7}  {:>9}  {:>18}\n", "image", "clients", "batch",
             "median ms", "p95 ms", "images/s", "CPU ms per image");
  const auto print = [](int side, int clients, int batch, const Times& times) {
    const auto images = static_cast<double>(batch) * static_cast<double>(times.milliseconds.size());
    fmt::print("{:>9}  {:>7}  {:>6}  {:>10.2f}  {:>7.2f}  {:>9.0f}  {:>18.2f}\n",
               fmt::format("{} x {}", side, side), clients, batch, times.quantile(0.5),
               times.quantile(0.95), images / times.seconds, 1000 * times.cpu_seconds / images);
    std::fflush(stdout);
  };
  for (const int side : options.sides) {
    const v1::PredictRequest one = testing::disc_image(side, 0);
    for (const int clients : options.clients) {
      print(side, clients, 1, measure(options.seconds, clients, [&] {
              grpc::ClientContext context;
              v1::PredictReply reply;
              require_ok(stub.Predict(&context, one, &reply));
            }));
    }
    if (options.batch == 0) continue;
    v1::PredictBatchRequest many;
    for (int i = 0; i < options.batch; ++i) *many.add_images() = testing::disc_image(side, 0.1 * i);
    print(side, 1, options.batch, measure(options.seconds, 1, [&] {
            grpc::ClientContext context;
            v1::PredictBatchReply reply;
            require_ok(stub.PredictBatch(&context, many, &reply));
          }));
  }
}

int run(int argc, char** argv) {
  Options options;
  CLI::App app("Latency and throughput of a predictor");
  app.add_option("--model", options.model,
                 "Checkpoint, or folder of a run; default: a residual network of random weights");
  app.add_option("--base-channels", options.base_channels, "Of that");
  app.add_option("--resolution", options.resolution, "Of that");
  app.add_option("--predictor", options.predictor,
                 "HOST:PORT of a running one; default: one in this process");
  app.add_option("--side", options.sides, "Of the images that are sent, in pixels")->delimiter(',');
  app.add_option("--batch", options.batch, "Images of a batch; 0: no batches");
  app.add_option("--clients", options.clients, "That ask for single images")->delimiter(',');
  app.add_option("--max-batch", options.max_batch, "As of itn-predictor");
  app.add_option("--threads", options.threads, "Of torch");
  app.add_option("--seconds", options.seconds, "Of each measurement");
  CLI11_PARSE(app, argc, argv);
  set_torch_threads(options.threads);
  std::optional<testing::TemporaryFolder> folder;
  std::unique_ptr<PredictServer> server;
  if (options.predictor.empty()) {
    if (options.model.empty()) {
      folder.emplace();
      options.model = folder->path("random.itn");
      v1::Checkpoint checkpoint;
      *checkpoint.mutable_model() = random_model(options);
      write_checkpoint(options.model, checkpoint);
    }
    PredictServerOptions serving;
    serving.listen = "127.0.0.1:0";
    serving.service.max_batch = options.max_batch;
    server = std::make_unique<PredictServer>(
        std::make_shared<ModelStore>(ModelStoreOptions{.models = {options.model}, .folder = {}}),
        serving);
    options.predictor = server->address();
  }
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  const auto stub = v1::PredictService::NewStub(
      grpc::CreateCustomChannel(options.predictor, grpc::InsecureChannelCredentials(), arguments));
  bench(options, *stub);
  return 0;
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::begin_with_passive_waiting(argv);
  return itn::run(argc, argv);
}
