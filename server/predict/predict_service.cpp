#include "server/predict/predict_service.h"

#include <fmt/format.h>

#include <stop_token>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/learning/predict_reply.h"
#include "common/rpc/wire_array.h"
#include "common/rpc/wire_check.h"

namespace itn {
namespace {

constexpr uint32_t kMaxSide = 16384;

// Before anything is allocated.
void check_sizes(const v1::PredictRequest& request, uint64_t max_pixels) {
  const auto check_side = [](const char* name, uint32_t side) {
    if (side < 1 || side > kMaxSide) {
      throw invalid_input(fmt::format("{} is {}; it must be in [1, {}]", name, side, kMaxSide));
    }
  };
  check_side("width", request.width());
  check_side("height", request.height());
  if (request.channels() != 0 && request.channels() != 1 && request.channels() != 3) {
    throw invalid_input(fmt::format("channels is {}; it must be 1 or 3", request.channels()));
  }
  const uint64_t pixels = uint64_t{request.width()} * request.height();
  if (pixels > max_pixels) {
    throw Error(ErrorKind::kLimit, fmt::format("the image has {} pixels; this predictor accepts {}",
                                               pixels, max_pixels));
  }
  const auto check_bytes = [](const char* name, const std::string& bytes, uint64_t values) {
    if (bytes.size() != values * sizeof(float)) {
      throw invalid_input(fmt::format("{} has {} bytes; its size needs {}", name, bytes.size(),
                                      values * sizeof(float)));
    }
  };
  check_bytes("image", request.image(), pixels * std::max(1U, request.channels()));
  check_bytes("mask", request.mask(), pixels);
}

v1::PredictReply predict(Predictor& predictor, const v1::PredictRequest& request,
                         const std::stop_token& stop) {
  const std::vector<float> pixels = from_bytes<float>(request.image());
  const std::vector<float> mask = from_bytes<float>(request.mask());
  const std::vector<MaterialEstimate> estimates =
      predictor.estimate({.width = static_cast<int>(request.width()),
                          .height = static_cast<int>(request.height()),
                          .channels = static_cast<int>(std::max(1U, request.channels())),
                          .pixels = pixels,
                          .mask = mask},
                         stop);
  return to_reply(estimates, predictor.name());
}

}  // namespace

// One Predict.
class PredictService::PredictCall final : public QueuedCall {
 public:
  PredictCall(PredictService& service, grpc::CallbackServerContext& context,
              grpc::ByteBuffer& reply)
      : QueuedCall(service.desk_, context, reply), service_(service) {}

 private:
  void accept(const grpc::ByteBuffer& bytes) override {
    parse_checked(bytes, "request", {}, request_);
    check_sizes(request_, service_.options_.max_pixels);
  }

  grpc::ByteBuffer work(std::stop_token stop) override {
    // The message, its arrays, and images of the crop at the photograph's own resolution.
    memory().resize(request_.image().size() * kImages + kPerPrediction);
    return serialized(predict(service_.predictor_, request_, stop));
  }

  std::string activity() const override { return "the prediction"; }

  static constexpr uint64_t kImages = 12;
  static constexpr uint64_t kPerPrediction = uint64_t{32} << 20;

  PredictService& service_;
  v1::PredictRequest request_;
};

PredictService::PredictService(Predictor predictor, const PredictServiceOptions& options)
    : options_(options),
      predictor_(std::move(predictor)),
      desk_({.threads = 1,
             .queue_capacity = options.queue_capacity,
             .memory_bytes = options.memory_bytes,
             .max_time = std::chrono::seconds(0)}) {}

grpc::ServerUnaryReactor* PredictService::Predict(grpc::CallbackServerContext* context,
                                                  const grpc::ByteBuffer* request,
                                                  grpc::ByteBuffer* reply) {
  return start_call<PredictCall>(*context, request, *this, *context, *reply);
}

}  // namespace itn
