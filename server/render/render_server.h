// A render worker: the render service behind a port, an in-process channel, or both.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/render/render_service.h"
#include "server/rpc/service_server.h"

namespace itn {

// `max_memory_bytes` lowers the limits of the service to what fits (plan_memory); messages are
// bounded by those limits.
struct RenderServerOptions : GrpcServerOptions {
  RenderServiceOptions service;
};

class RenderServer : public ServiceServer<RenderService> {
 public:
  // Memory that the program takes: its libraries, its threads, and a thousand connections.
  static constexpr uint64_t kOwnBytes = uint64_t{128} << 20;

  explicit RenderServer(const RenderServerOptions& options);

  // Renders that are worked on now, and those that were accepted and wait.
  size_t running() const { return service().running(); }
  size_t waiting() const { return service().waiting(); }
};

}  // namespace itn
