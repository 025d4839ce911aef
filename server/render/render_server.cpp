#include "server/render/render_server.h"

#include <algorithm>

#include "server/rpc/memory_plan.h"

namespace itn {
namespace {

RenderServiceOptions service_options(const RenderServerOptions& options) {
  RenderServiceOptions service = options.service;
  if (options.max_memory_bytes == 0) return service;
  uint64_t& message_bytes = service.limits.max_message_bytes;
  const MemoryPlan plan =
      plan_memory(options.max_memory_bytes, RenderServer::kOwnBytes, message_bytes);
  message_bytes = plan.message_bytes;
  service.cache_bytes = std::min<size_t>(service.cache_bytes, plan.call_bytes / 3);
  service.memory_bytes = plan.call_bytes - service.cache_bytes;
  return service;
}

GrpcServerOptions server_options(const RenderServerOptions& options) {
  GrpcServerOptions server = options;
  server.max_message_bytes = options.service.limits.max_message_bytes;
  return within_memory(server, RenderServer::kOwnBytes);
}

}  // namespace

RenderServer::RenderServer(const RenderServerOptions& options)
    : ServiceServer(server_options(options), service_options(options)) {}

}  // namespace itn
