// A predictor: the prediction service behind a port.
#pragma once

#include <cstdint>
#include <memory>

#include "server/predict/predict_service.h"
#include "server/rpc/service_server.h"

namespace itn {

// Options like RenderServerOptions.
struct PredictServerOptions : GrpcServerOptions {
  PredictServiceOptions service;
};

class PredictServer : public ServiceServer<PredictService> {
 public:
  // Memory that the program takes: with LibTorch, its threads, and a network.
  static constexpr uint64_t kOwnBytes = uint64_t{512} << 20;

  PredictServer(std::shared_ptr<const ModelStore> models, const PredictServerOptions& options);
};

}  // namespace itn
