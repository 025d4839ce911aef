// A predictor: the prediction service with health service and reflection.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "common/rpc/grpc_server.h"
#include "server/predict/predict_service.h"

namespace itn {

struct PredictServerOptions {
  std::string listen;  // as in GrpcServerOptions
  bool reflection = true;
  uint64_t max_memory_bytes = 0;  // as in RenderServerOptions
  PredictServiceOptions service;
};

class PredictServer {
 public:
  // Throws Error (kUsage) if the address is none, kIo if it cannot listen.
  PredictServer(Predictor predictor, const PredictServerOptions& options);
  // Stops what is under way and answers it UNAVAILABLE.
  ~PredictServer();

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return server_.address(); }

  std::shared_ptr<grpc::Channel> in_process_channel() { return server_.in_process_channel(); }

  // As RenderServer::drain().
  void drain(std::chrono::duration<double> patience);

 private:
  PredictService service_;
  GrpcServer server_;  // last: it calls the service
};

}  // namespace itn
