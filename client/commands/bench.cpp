// itn bench: how fast a running worker or predictor answers, at one load after the other.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/text_format.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "client/bench/bench_call.h"
#include "client/bench/bench_report.h"
#include "client/bench/load.h"
#include "client/bench/statistics.h"
#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/commands/render_request.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "client/render_pool/render_pool.h"
#include "client/render_pool/reply_images.h"
#include "common/error.h"
#include "common/flags.h"
#include "common/image/image.h"
#include "common/rpc/channel.h"
#include "common/rpc/deadline.h"
#include "common/rpc/status.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_file.h"
#include "itn/v1/predict.grpc.pb.h"
#include "itn/v1/render.grpc.pb.h"
#include "itn/v1/status.grpc.pb.h"

namespace itn {
namespace {

constexpr const char* kRenderGrad = "RenderGrad";
constexpr const char* kPredict = "Predict";

// Calls are waited for within so many times the length of a window, where they are few.
constexpr double kLongestWindow = 10;

// Without --scene: a cube on the ground under sun and sky.
constexpr const char* kScene = R"(
  object { mesh { builtin: "cube" } }
  surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } reflectance: 0.5 }
  lights { sun_sky { turbidity: 3 sun_elevation_degrees: 60 sun_angular_radius_degrees: 18.75 } }
  camera { origin { y: 9.28 z: -32.8 } target { y: 0.5 } fov_degrees: 2.5 }
  film { width: 128 height: 128 })";

struct BenchOptions {
  std::string address;
  std::string call;  // empty: what the server is for
  ClientSecurity security;
  int connections = 1;
  double timeout = 60;  // in seconds
  // The load.
  std::vector<size_t> concurrency{1};
  std::vector<double> rates;
  std::string distribution = "constant";
  uint64_t seed = 0;
  size_t max_outstanding = 1024;
  // The measurement.
  double window = 5;  // in seconds
  size_t window_calls = 50;
  double stability = 10;  // in per cent
  size_t max_windows = 10;
  // The request.
  std::string scene;
  std::string size;
  uint32_t spp = 16;
  Material material{.sigma_t = 100, .albedo = 0.8, .g = 0.2};
  std::vector<std::string> derivatives;
  std::string image;
  std::string model, version;
  std::string format = "text";
};

// ---- The request -------------------------------------------------------------------------------

v1::Scene built_in_scene() {
  v1::Scene scene;
  google::protobuf::TextFormat::ParseFromString(kScene, &scene);
  return scene;
}

RenderJob render_job(const BenchOptions& options) {
  v1::Scene scene = options.scene.empty() ? built_in_scene() : load_scene(options.scene);
  if (!options.size.empty()) set_film("--size", options.size, *scene.mutable_film());
  RenderJob job;
  job.scene = serialize(scene);
  *job.request.mutable_material() = to_proto(options.material);
  job.request.set_spp(options.spp);
  for (const std::string& name : options.derivatives) add_derivative(name, job.request);
  return job;
}

// Made in this process.
Image rendered_image(const BenchOptions& options) {
  RenderJob job = render_job(options);
  job.request.clear_derivatives();
  job.request.clear_scene_derivatives();
  RenderPool pool({});
  const v1::RenderGradReply reply = pool.render_split(job);
  Image image;
  image.width = static_cast<int>(reply.width());
  image.height = static_cast<int>(reply.height());
  image.channels["Y"] = mean_radiance(reply, options.spp);
  image.channels["mask.Y"] = from_bytes<float>(reply.mask());
  return image;
}

v1::PredictRequest predict_request(const BenchOptions& options) {
  const Image image = options.image.empty() ? rendered_image(options) : read_exr(options.image);
  v1::PredictRequest request;
  request.set_width(static_cast<uint32_t>(image.width));
  request.set_height(static_cast<uint32_t>(image.height));
  request.set_channels(1);
  request.set_image(to_bytes(image.channel("Y")));
  request.set_mask(to_bytes(image.channel("mask.Y")));
  request.set_model(options.model);
  request.set_version(options.version);
  return request;
}

// ---- The server --------------------------------------------------------------------------------

std::chrono::milliseconds timeout_of(const BenchOptions& options) {
  return std::chrono::milliseconds(static_cast<int64_t>(options.timeout * 1000));
}

// Of a call that failed: why.
grpc::Status explained(const grpc::Status& status, const BenchOptions& options,
                       const Connector& connector) {
  if (status.error_code() != grpc::StatusCode::DEADLINE_EXCEEDED) {
    return connector.explained(status, options.address);
  }
  return {status.error_code(), fmt::format("no answer within --timeout {:g} s", options.timeout)};
}

// What the server is for, as it says itself.
std::string call_of(const BenchOptions& options, const Connector& connector) {
  if (!options.call.empty()) return options.call;
  const auto stub = v1::StatusService::NewStub(connector.connect_to(options.address));
  grpc::ClientContext context;
  context.set_deadline(deadline_in(timeout_of(options)));
  v1::ServerStatus server;
  const grpc::Status status = explained(stub->GetStatus(&context, {}, &server), options, connector);
  if (!status.ok() && status.error_code() != grpc::StatusCode::UNIMPLEMENTED) {
    throw to_error(status, options.address);
  }
  if (server.service() == v1::RenderService::service_full_name()) return kRenderGrad;
  if (server.service() == v1::PredictService::service_full_name()) return kPredict;
  throw Error(ErrorKind::kUnavailable,
              options.address +
                  " does not say that it is a worker or predictor of this version; say by --call "
                  "what to call");
}

BenchRequest request_of(const BenchOptions& options, const std::string& call) {
  if (call == kPredict) {
    if (!options.derivatives.empty()) {
      throw Error(ErrorKind::kUsage,
                  "--derivatives are a worker's, and " + options.address + " is a predictor");
    }
    return bench_request(predict_request(options));
  }
  if (!options.image.empty() || !options.model.empty() || !options.version.empty()) {
    throw Error(ErrorKind::kUsage, "--image, --model and --model-version are for predictors, and " +
                                       options.address + " is a worker");
  }
  return bench_request(render_job(options));
}

BenchCaller caller_to(const BenchOptions& options, const Connector& connector,
                      const std::string& call) {
  std::vector<std::shared_ptr<grpc::Channel>> channels;
  channels.reserve(static_cast<size_t>(options.connections));
  for (int i = 0; i < options.connections; ++i) {
    channels.push_back(connector.connect_to(options.address));
  }
  return {channels, request_of(options, call), timeout_of(options)};
}

// ---- Measurement -------------------------------------------------------------------------------

BenchFormat format_of(const std::string& name) {
  if (name == "csv") return BenchFormat::kCsv;
  return name == "json" ? BenchFormat::kJson : BenchFormat::kText;
}

BenchResult measure(const BenchOptions& options, const LoadOptions& load, BenchCaller& caller) {
  Load running(load, [&](const std::stop_token& stop, Load::Done done) {
    caller.start(stop, std::move(done));
  });
  return measure_until_stable(
      {.tolerance = options.stability / 100, .max_windows = options.max_windows}, [&] {
        BenchWindow window = running.measure(options.window, options.window_calls,
                                             kLongestWindow * options.window, interruption());
        throw_if_interrupted();
        return window;
      });
}

std::vector<LoadOptions> loads_of(const BenchOptions& options) {
  LoadOptions load{.callers = 1,
                   .rate = 0,
                   .distribution = options.distribution == "poisson"
                                       ? ArrivalDistribution::kPoisson
                                       : ArrivalDistribution::kConstant,
                   .seed = options.seed,
                   .max_outstanding = options.max_outstanding};
  std::vector<LoadOptions> loads;
  for (const double rate : options.rates) {
    load.rate = rate;
    loads.push_back(load);
  }
  if (!loads.empty()) return loads;
  for (const size_t callers : options.concurrency) {
    load.callers = callers;
    loads.push_back(load);
  }
  return loads;
}

// What follows a message about calls that failed; nothing if none had ended.
std::string in_words(const grpc::Status& last_failure, const BenchOptions& options,
                     const Connector& connector) {
  if (last_failure.ok()) return "";
  return "; the last error: " + message_of(explained(last_failure, options, connector));
}

void bench(const BenchOptions& options) {
  const Connector connector(options.security);
  const std::string call = call_of(options, connector);
  BenchCaller caller = caller_to(options, connector, call);
  double units_per_call = 0;
  const grpc::Status first = explained(caller.try_once(units_per_call), options, connector);
  throw_if_interrupted();
  if (first.error_code() == grpc::StatusCode::UNIMPLEMENTED) {
    throw Error(ErrorKind::kUnavailable, options.address + " does not know " + call);
  }
  if (!first.ok()) throw to_error(first, options.address);
  const BenchFormat format = format_of(options.format);
  const bool open_loop = !options.rates.empty();
  print_result(bench_header(format, open_loop, caller.unit()));
  std::fflush(stdout);
  std::vector<double> unanswered;  // loads
  grpc::Status last_failure;       // at one of them
  for (const LoadOptions& load : loads_of(options)) {
    const BenchRow row{.open_loop = open_loop,
                       .load = open_loop ? load.rate : static_cast<double>(load.callers),
                       .units_per_call = units_per_call,
                       .result = measure(options, load, caller)};
    print_result(bench_line(format, row, caller.unit()));
    std::fflush(stdout);
    if (row.result.last.answered() > 0) continue;
    unanswered.push_back(row.load);
    if (!row.result.last.last_failure.ok()) last_failure = row.result.last.last_failure;
  }
  if (unanswered.empty()) return;
  throw Error(ErrorKind::kUnavailable,
              fmt::format("{} answered no call at {} {:g}{}", options.address,
                          open_loop ? "--rate" : "--concurrency", fmt::join(unanswered, ", "),
                          in_words(last_failure, options, connector)));
}

// ---- Flags -------------------------------------------------------------------------------------

void add_load_flags(CLI::App& command, BenchOptions& options) {
  const auto concurrency =
      command
          .add_option("--concurrency", options.concurrency,
                      "Closed loop: callers, each of whom calls again when it is answered; several "
                      "numbers, separated by commas, are measured one after the other")
          ->delimiter(',')
          ->allow_extra_args(false)
          ->check(number_in(size_t{1}, size_t{10'000}))
          ->capture_default_str();
  const auto rate =
      command
          .add_option("--rate", options.rates,
                      "Open loop: calls a second, whatever becomes of them, instead of "
                      "--concurrency; several likewise. Latencies count from when a call was due")
          ->delimiter(',')
          ->allow_extra_args(false)
          ->check(number_in(1e-3, 1e6))
          ->excludes(concurrency);
  command
      .add_option("--request-distribution", options.distribution,
                  "Of --rate: constant gaps, or those of a Poisson process")
      ->check(one_of({"constant", "poisson"}))
      ->needs(rate)
      ->capture_default_str();
  command.add_option("--seed", options.seed, "Of the Poisson process")
      ->check(kAnySeed)
      ->needs(rate)
      ->capture_default_str();
  command
      .add_option("--max-outstanding", options.max_outstanding,
                  "Of --rate: most calls under way; further ones that are due wait here")
      ->check(number_in(size_t{1}, size_t{10'000}))
      ->needs(rate)
      ->capture_default_str();
  command
      .add_option("--connections", options.connections,
                  "To the server, which calls go over in turn; each takes 256 calls at a time")
      ->check(number_in(1, 1024))
      ->capture_default_str();
}

void add_measurement_flags(CLI::App& command, BenchOptions& options) {
  command.add_option("--window", options.window, "Least length of a measurement, in seconds")
      ->check(number_in(0.001, 3600.0))
      ->capture_default_str();
  command
      .add_option("--window-calls", options.window_calls,
                  "Least calls of a measurement, which lasts until they have ended, but not longer "
                  "than ten times --window")
      ->check(number_in(size_t{1}, size_t{1'000'000}))
      ->capture_default_str();
  command
      .add_option("--stability", options.stability,
                  "Measured until throughput, p50 and p99 of three windows in a row are within "
                  "this of their means, in per cent")
      ->check(number_in(0.0, 1000.0))
      ->capture_default_str();
  command.add_option("--max-windows", options.max_windows, "Or until there were so many")
      ->check(number_in(size_t{1}, size_t{1000}))
      ->capture_default_str();
}

void add_request_flags(CLI::App& command, BenchOptions& options) {
  const std::vector<CLI::Option*> of_a_render = {
      command.add_option("--scene", options.scene,
                         "Scene file to be rendered, as itn render takes. Default: a cube on the "
                         "ground under sun and sky"),
      command.add_option("--size", options.size,
                         "WIDTHxHEIGHT in pixels, instead of the scene's. Default scene: 128x128"),
      command.add_option("--spp", options.spp, "Samples per pixel")
          ->check(kSppRange)
          ->capture_default_str(),
      command.add_option("--sigma-t", options.material.sigma_t, "Extinction coefficient, in 1/mm")
          ->check(number_in(kMinSigmaT, kMaxSigmaT))
          ->capture_default_str(),
      command.add_option("--albedo", options.material.albedo, "Single-scattering albedo")
          ->check(number_in(0.0, 1.0))
          ->capture_default_str(),
      command.add_option("--g", options.material.g, "Mean cosine of scattering")
          ->check(number_in(-kMaxAbsG, kMaxAbsG))
          ->capture_default_str()};
  command
      .add_option("--derivatives", options.derivatives,
                  "Derivative images to ask a worker for, as of itn render. Default: none")
      ->delimiter(',')
      ->allow_extra_args(false);
  CLI::Option* image = command.add_option("--image", options.image,
                                          "EXR to ask a predictor about, with the channels Y and "
                                          "mask.Y, as itn render writes. Default: "
                                          "the render of the flags above, made in this process");
  for (CLI::Option* render : of_a_render) image->excludes(render);
  command
      .add_option("--model", options.model,
                  "Of the predictor's models, this one; default: the predictor's own default")
      ->check(kModelName);
  command.add_option("--model-version", options.version, "Of the model; default: its newest")
      ->check(kModelName);
}

}  // namespace

void add_bench_command(CLI::App& app) {
  const auto options = std::make_shared<BenchOptions>();
  CLI::App* command = app.add_subcommand(
      "bench", "Measure throughput and latencies of a running worker or predictor");
  command->add_option("server", options->address, "HOST:PORT")->required()->check(kOneServer);
  command
      ->add_option("--call", options->call,
                   "RenderGrad of a worker, or Predict of a predictor. Default: what the server is")
      ->check(one_of({kRenderGrad, kPredict}));
  add_security_flags(*command, options->security);
  command->add_option("--timeout", options->timeout, "Of a call, in seconds")
      ->check(number_in(0.01, 3600.0))
      ->capture_default_str();
  add_load_flags(*command, *options);
  add_measurement_flags(*command, *options);
  add_request_flags(*command, *options);
  command
      ->add_option("--format", options->format,
                   "text: a table; csv; json: an object for each load, one a line")
      ->check(one_of({"text", "csv", "json"}))
      ->capture_default_str();
  command->callback([options] { bench(*options); });
}

}  // namespace itn
