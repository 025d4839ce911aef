// itn-worker: a render worker. Serves until SIGTERM or SIGINT, then finishes what is under way.
#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "common/flags.h"
#include "server/render/render_server.h"
#include "server/server_main.h"

namespace itn {
namespace {

struct WorkerOptions {
  RenderServerOptions server;
  uint64_t max_message_mb = 256;
  uint64_t cache_mb = 512;
  ServerFlags flags;
};

void add_flags(CLI::App& app, WorkerOptions& options) {
  RenderServiceOptions& service = options.server.service;
  app.add_option("--threads", service.threads, "Threads of each render; 0: one per processor")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  app.add_option("--renders", service.renders, "Renders at a time")
      ->check(number_in(1, 1024))
      ->capture_default_str();
  app.add_option("--queue", service.queue_capacity,
                 "Requests that may wait; more are answered UNAVAILABLE")
      ->check(number_in(0, 10'000))
      ->capture_default_str();
  app.add_option(
         "--cache-mb", options.cache_mb,
         "Memory for scenes, in MiB; at most about a quarter of --max-memory-mb. A scene that "
         "does not fit is forgotten when no request uses it any more")
      ->check(number_in(0, 1 << 20))
      ->capture_default_str();
  app.add_option("--max-pixels", service.limits.max_pixels, "Most pixels of an image")
      ->check(number_in(1U, 1U << 31))
      ->capture_default_str();
  app.add_option("--max-spp", service.limits.max_spp, "Most samples per pixel")
      ->check(number_in(1, 1 << 20))
      ->capture_default_str();
  app.add_option("--max-triangles", service.limits.max_triangles,
                 "Most triangles of all meshes of a scene together")
      ->check(number_in(1U, 1U << 31))
      ->capture_default_str();
  app.add_option("--max-seconds", service.max_seconds,
                 "Longest render, its scene included, in seconds; what takes longer is stopped and "
                 "answered RESOURCE_EXHAUSTED. 0: no limit")
      ->check(number_in(0.0, 1e9))
      ->capture_default_str();
  app.add_option(
         "--max-message-mb", options.max_message_mb,
         "Largest request and largest reply, in MiB; at most a sixteenth of --max-memory-mb")
      ->check(number_in(1, 2047))
      ->capture_default_str();
  add_server_flags(app, "itn-worker", RenderServer::kOwnBytes, options.server, options.flags);
}

int run(int argc, char** argv) {
  WorkerOptions options;
  options.server.listen = "127.0.0.1:50051";
  CLI::App app(
      "Render worker of itn: images of translucent objects and their derivatives, over gRPC.",
      "itn-worker");
  add_flags(app, options);
  return server_main(app, "itn-worker", argc, argv, options.flags, [&] {
    options.server.service.limits.max_message_bytes = options.max_message_mb << 20;
    options.server.max_memory_bytes = options.flags.max_memory_bytes();
    options.server.service.log_calls = true;
    options.server.service.cache_bytes = options.cache_mb << 20;
    return std::make_unique<RenderServer>(options.server);
  });
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  return itn::run(argc, argv);
}
