#include "server/predict/predict_server.h"

#include <utility>

namespace itn {
namespace {

// Of a request: three channels and a mask, and a little for the rest.
uint64_t max_message_bytes(uint64_t max_pixels) {
  return max_pixels * 4 * sizeof(float) + (uint64_t{1} << 20);
}

}  // namespace

PredictServer::PredictServer(Predictor predictor, const PredictServerOptions& options)
    : service_(std::move(predictor), options.service),
      server_({options.listen, options.reflection, max_message_bytes(options.service.max_pixels)},
              service_, v1::PredictService::service_full_name()) {}

void PredictServer::drain() {
  server_.stop_serving();
  service_.drain();
  server_.shut_down();
}

}  // namespace itn
