// itn-predictor: answers optical parameters for images, by a trained network. Serves until SIGTERM
// or SIGINT, then finishes what is under way.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <string>
#include <thread>

#include "common/flags.h"
#include "common/learning/encoder.h"
#include "common/learning/model_files.h"
#include "common/passive_waiting.h"
#include "server/predict/predict_server.h"
#include "server/server_main.h"

namespace itn {
namespace {

struct PredictorOptions {
  std::string model;
  PredictServerOptions server{.listen = "127.0.0.1:50052",
                              .security = {},
                              .reflection = true,
                              .max_memory_bytes = 0,
                              .service = {}};
  int threads = 0;
  ServerFlags flags;
};

void add_flags(CLI::App& app, PredictorOptions& options) {
  app.add_option("--model", options.model,
                 fmt::format("Name of a model that itn models lists, checkpoint of itn train, or "
                             "folder of a run; default: {}",
                             kDefaultModel));
  app.add_option("--threads", options.threads, "Threads of each prediction; 0: one per processor")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  app.add_option("--max-pixels", options.server.service.max_pixels,
                 "Most pixels of an image, or of a batch together")
      ->check(number_in(1, 1 << 26))
      ->capture_default_str();
  app.add_option("--queue", options.server.service.queue_capacity,
                 "Requests that may wait; more are answered UNAVAILABLE")
      ->check(number_in(0, 10'000))
      ->capture_default_str();
  add_server_flags(app, "itn-predictor", PredictServer::kOwnBytes, options.server.listen,
                   options.server.security, options.server.reflection, options.flags);
}

int run(int argc, char** argv) {
  PredictorOptions options;
  CLI::App app("Predictor of itn: optical parameters of the object in an image, over gRPC.");
  add_flags(app, options);
  return server_main(app, "itn-predictor", argc, argv, options.flags, [&] {
    const int processors = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    set_torch_threads(options.threads > 0 ? options.threads : processors);
    options.server.max_memory_bytes = options.flags.max_memory_bytes();
    return std::make_unique<PredictServer>(Predictor::load(find_model(options.model)),
                                           options.server);
  });
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::begin_with_passive_waiting(argv);
  return itn::run(argc, argv);
}
