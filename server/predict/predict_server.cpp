#include "server/predict/predict_server.h"

#include <utility>

#include "server/rpc/memory_plan.h"

namespace itn {
namespace {

// The largest request: three channels and a mask, and a little for the rest.
uint64_t max_message_bytes(uint64_t max_pixels) {
  return max_pixels * 4 * sizeof(float) + (uint64_t{1} << 20);
}

GrpcServerOptions server_options(const PredictServerOptions& options) {
  GrpcServerOptions server = options;
  server.max_message_bytes = max_message_bytes(options.service.max_pixels);
  return within_memory(server, PredictServer::kOwnBytes);
}

PredictServiceOptions service_options(const PredictServerOptions& options) {
  PredictServiceOptions service = options.service;
  if (options.max_memory_bytes > 0) {
    service.memory_bytes = plan_memory(options.max_memory_bytes, PredictServer::kOwnBytes,
                                       max_message_bytes(service.max_pixels))
                               .call_bytes;
  }
  return service;
}

}  // namespace

PredictServer::PredictServer(std::shared_ptr<const ModelStore> models,
                             const PredictServerOptions& options)
    : ServiceServer(server_options(options), std::move(models), service_options(options)) {}

}  // namespace itn
