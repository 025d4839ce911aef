// A predictor: the prediction service with health service and reflection.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "common/rpc/service_server.h"
#include "server/predict/predict_service.h"

namespace itn {

struct PredictServerOptions {
  std::string listen;  // as in GrpcServerOptions
  ServerSecurity security = {};
  std::optional<bool> reflection;  // GrpcServerOptions
  uint64_t max_memory_bytes = 0;   // as in RenderServerOptions
  PredictServiceOptions service;
};

class PredictServer : public ServiceServer<PredictService> {
 public:
  // Of memory: the program with LibTorch, its threads, and a network.
  static constexpr uint64_t kOwnBytes = uint64_t{512} << 20;

  PredictServer(std::shared_ptr<const ModelStore> models, const PredictServerOptions& options);
};

}  // namespace itn
