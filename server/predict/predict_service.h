// itn.v1.PredictService: checks requests, predicts on a thread of its own, answers.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

#include "common/learning/predictor.h"
#include "common/rpc/queued_call.h"
#include "itn/v1/predict.grpc.pb.h"

namespace itn {

// Images of a PredictBatchRequest.
inline constexpr int kMaxBatchImages = 1024;

struct PredictServiceOptions {
  uint64_t max_pixels = uint64_t{1} << 22;  // width * height, of all images of a call together
  size_t queue_capacity = 64;               // requests that wait
  uint64_t memory_bytes = 0;                // of all requests under way together; 0: no limit
};

// The bytes of requests are parsed here, not by gRPC: see RenderService.
class PredictService final
    : public v1::PredictService::WithRawCallbackMethod_PredictBatch<
          v1::PredictService::WithRawCallbackMethod_Predict<v1::PredictService::Service>> {
 public:
  PredictService(Predictor predictor, const PredictServiceOptions& options);

  grpc::ServerUnaryReactor* Predict(grpc::CallbackServerContext* context,
                                    const grpc::ByteBuffer* request,
                                    grpc::ByteBuffer* reply) override;
  grpc::ServerUnaryReactor* PredictBatch(grpc::CallbackServerContext* context,
                                         const grpc::ByteBuffer* request,
                                         grpc::ByteBuffer* reply) override;

  static std::string full_name() { return v1::PredictService::service_full_name(); }

  bool can_take_work() const { return desk_.can_take_work(); }

  // See CallDesk.
  bool drain(std::chrono::duration<double> patience) { return desk_.drain(patience); }

 private:
  class PredictCall;
  class BatchCall;

  const PredictServiceOptions options_;
  Predictor predictor_;  // used by the desk's thread alone
  CallDesk desk_;        // last: its thread uses what is above
};

}  // namespace itn
