// A predictor: the prediction service behind a port.
#pragma once

#include <cstdint>
#include <memory>

#include "common/rpc/service_server.h"
#include "server/predict/predict_service.h"

namespace itn {

// As RenderServerOptions.
struct PredictServerOptions : GrpcServerOptions {
  PredictServiceOptions service;
};

class PredictServer : public ServiceServer<PredictService> {
 public:
  // Of memory: the program with LibTorch, its threads, and a network.
  static constexpr uint64_t kOwnBytes = uint64_t{512} << 20;

  PredictServer(std::shared_ptr<const ModelStore> models, const PredictServerOptions& options);
};

}  // namespace itn
