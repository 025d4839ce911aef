// itn-predictor: answers optical parameters for images, by a trained network. Serves until SIGTERM
// or SIGINT, then finishes what is under way. On SIGHUP, looks at its models' files again.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "common/flags.h"
#include "common/learning/encoder.h"
#include "common/learning/model_files.h"
#include "common/passive_waiting.h"
#include "server/predict/model_store.h"
#include "server/predict/model_watcher.h"
#include "server/predict/predict_server.h"
#include "server/server_main.h"

namespace itn {
namespace {

struct PredictorOptions {
  ModelStoreOptions models;
  double reload_seconds = 2;
  PredictServerOptions server;
  int threads = 1;
  ServerFlags flags;
};

void add_flags(CLI::App& app, PredictorOptions& options) {
  app.add_option(
         "--model", options.models.models,
         fmt::format("[NAME=]MODEL: a model to answer with, and what requests call it. MODEL "
                     "is the name of one that itn models lists, a checkpoint of itn train, "
                     "or the folder of a run; NAME is by default that name, or the model's "
                     "own. May be given several times; the first that takes a photograph's "
                     "channels answers requests that name none. Default, without --models: {}, "
                     "{} for photographs of one channel, and {}",
                     kDefaultModel, kDefaultGrayModel, kScaleModel))
      ->allow_extra_args(false);
  app.add_option(
      "--models", options.models.folder,
      fmt::format("Folder of models NAME.itn and NAME/VERSION.itn, to answer with too. A "
                  "request that names no version gets the newest. Without --model, one "
                  "that names none gets the only one, or {}, or, of one channel, {}",
                  kDefaultModel, kDefaultGrayModel));
  app.add_option("--reload-seconds", options.reload_seconds,
                 "Look so often, in seconds, whether files of models have changed; 0: on SIGHUP "
                 "alone. What is new is loaded and checked while the old one answers")
      ->check(number_in(0.0, 86400.0))
      ->capture_default_str();
  app.add_option("--max-batch", options.server.service.max_batch,
                 "Requests worked on at a time: what waits for one model together goes through its "
                 "network together. Answers do not depend on it")
      ->check(number_in(1, 256))
      ->capture_default_str();
  app.add_option(
         "--network-threads,--threads", options.threads,
         "Threads of the network; 0: one per processor. On two processors a second one made "
         "every answer later")
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
  add_server_flags(app, "itn-predictor", PredictServer::kOwnBytes, options.server, options.flags);
}

// A server, and what keeps its models as their files are.
class Program {
 public:
  explicit Program(const PredictorOptions& options)
      : models_(std::make_shared<ModelStore>(options.models)),
        server_(models_, options.server),
        watcher_(models_, std::chrono::duration<double>(options.reload_seconds)) {}

  const std::string& address() const { return server_.address(); }
  bool drain(std::chrono::duration<double> patience) { return server_.drain(patience); }
  ServerMetrics metrics() const { return server_.metrics(); }

 private:
  std::shared_ptr<ModelStore> models_;
  PredictServer server_;
  ModelWatcher watcher_;
};

int run(int argc, char** argv) {
  PredictorOptions options;
  options.server.listen = "127.0.0.1:50052";
  CLI::App app("Predictor of itn: optical parameters of the object in an image, over gRPC.",
               "itn-predictor");
  add_flags(app, options);
  return server_main(app, "itn-predictor", argc, argv, options.flags, [&] {
    const int processors = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
    set_torch_threads(options.threads > 0 ? options.threads : processors);
    options.server.max_memory_bytes = options.flags.max_memory_bytes();
    options.server.service.log_calls = true;
    if (options.models.models.empty() && options.models.folder.empty()) {
      for (const char* const name : {kDefaultModel, kDefaultGrayModel, kScaleModel}) {
        options.models.models.push_back(fmt::format("{}={}", name, find_model("", name).string()));
      }
    }
    return std::make_unique<Program>(options);
  });
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::begin_with_passive_waiting(argv);
  return itn::run(argc, argv);
}
