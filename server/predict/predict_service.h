// itn.v1.PredictService: checks requests, predicts on a thread of its own, answers.
#pragma once

#include <cstddef>
#include <cstdint>

#include "common/learning/predictor.h"
#include "common/rpc/job_queue.h"
#include "itn/v1/predict.grpc.pb.h"

namespace itn {

struct PredictServiceOptions {
  uint64_t max_pixels = uint64_t{1} << 22;  // width * height
  size_t queue_capacity = 64;               // requests that wait
};

class PredictService final : public v1::PredictService::CallbackService {
 public:
  PredictService(Predictor predictor, const PredictServiceOptions& options);

  grpc::ServerUnaryReactor* Predict(grpc::CallbackServerContext* context,
                                    const v1::PredictRequest* request,
                                    v1::PredictReply* reply) override;

  // Answers further requests UNAVAILABLE; returns when those accepted before are answered.
  void drain() { queue_.drain(); }

 private:
  class PredictCall;

  const PredictServiceOptions options_;
  Predictor predictor_;  // used by the queue's thread alone
  JobQueue queue_;       // last: its thread uses what is above
};

}  // namespace itn
