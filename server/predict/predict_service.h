// itn.v1.PredictService: checks requests, predicts on threads of its own, answers.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "common/learning/predictor.h"
#include "itn/v1/predict.grpc.pb.h"
#include "server/predict/model_store.h"
#include "server/predict/network_thread.h"
#include "server/rpc/metrics.h"
#include "server/rpc/queued_call.h"

namespace itn {

// Images of a PredictBatchRequest.
inline constexpr int kMaxBatchImages = 1024;

struct PredictServiceOptions {
  uint64_t max_pixels = uint64_t{1} << 22;  // width * height, of all images of a call together
  size_t queue_capacity = 64;               // requests that wait, beside those worked on
  // Requests worked on at a time, whose images go through the network together.
  int max_batch = 16;
  uint64_t memory_bytes = 0;  // of all requests under way together; 0: no limit
  bool log_calls = false;     // a line for each that is answered
};

// The bytes of requests are parsed here, not by gRPC: see RenderService.
class PredictService final
    : public v1::PredictService::WithRawCallbackMethod_ListModels<
          v1::PredictService::WithRawCallbackMethod_PredictBatch<
              v1::PredictService::WithRawCallbackMethod_Predict<v1::PredictService::Service>>> {
 public:
  PredictService(std::shared_ptr<const ModelStore> models, const PredictServiceOptions& options);

  grpc::ServerUnaryReactor* Predict(grpc::CallbackServerContext* context,
                                    const grpc::ByteBuffer* request,
                                    grpc::ByteBuffer* reply) override;
  grpc::ServerUnaryReactor* PredictBatch(grpc::CallbackServerContext* context,
                                         const grpc::ByteBuffer* request,
                                         grpc::ByteBuffer* reply) override;

  grpc::ServerUnaryReactor* ListModels(grpc::CallbackServerContext* context,
                                       const grpc::ByteBuffer* request,
                                       grpc::ByteBuffer* reply) override;

  static std::string full_name() { return v1::PredictService::service_full_name(); }

  void describe(ServerMetrics& metrics) const { scheduler_.describe(metrics); }

  // See CallScheduler.
  bool drain(std::chrono::duration<double> patience) { return scheduler_.drain(patience); }

 private:
  class Call;
  class PredictCall;
  class BatchCall;

  const PredictServiceOptions options_;
  const std::shared_ptr<const ModelStore> models_;
  std::mutex preparing_;  // photographs are, one at a time, as each may take much memory
  NetworkThread network_;
  CallScheduler scheduler_;  // last: its threads use what is above
};

}  // namespace itn
