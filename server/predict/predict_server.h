// A predictor: the prediction service with health service and reflection.
#pragma once

#include <string>

#include "common/rpc/grpc_server.h"
#include "server/predict/predict_service.h"

namespace itn {

struct PredictServerOptions {
  std::string listen;  // as in GrpcServerOptions
  bool reflection = true;
  PredictServiceOptions service;
};

class PredictServer {
 public:
  // Throws Error (kIo) if it cannot listen.
  PredictServer(Predictor predictor, const PredictServerOptions& options);

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return server_.address(); }

  std::shared_ptr<grpc::Channel> in_process_channel() { return server_.in_process_channel(); }

  // Reports NOT_SERVING, answers new requests UNAVAILABLE, returns when those accepted before are
  // answered. Without it, the destructor cancels what is under way.
  void drain();

 private:
  PredictService service_;
  GrpcServer server_;  // last: it calls the service
};

}  // namespace itn
