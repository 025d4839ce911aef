// A render worker: the render service with health service and reflection, behind a port, an
// in-process channel, or both.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "common/rpc/service_server.h"
#include "server/render/render_service.h"

namespace itn {

struct RenderServerOptions {
  std::string listen;  // as in GrpcServerOptions
  ServerSecurity security = {};
  std::optional<bool> reflection;  // GrpcServerOptions
  // Of the process, resident; 0: no limit. Lowers the limits of the service to what fits
  // (plan_memory).
  uint64_t max_memory_bytes = 0;
  RenderServiceOptions service;
};

class RenderServer : public ServiceServer<RenderService> {
 public:
  // Of memory: the program, its libraries, its threads, and a thousand connections.
  static constexpr uint64_t kOwnBytes = uint64_t{128} << 20;

  explicit RenderServer(const RenderServerOptions& options);

  // Renders that are worked on now, and those that were accepted and wait.
  size_t running() const { return service().running(); }
  size_t waiting() const { return service().waiting(); }
};

}  // namespace itn
