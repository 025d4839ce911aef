#include "server/predict/predict_service.h"

#include <fmt/format.h>

#include <algorithm>
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

// The arrays of a request whose sizes are checked, as a photograph.
class RequestPhotograph {
 public:
  explicit RequestPhotograph(const v1::PredictRequest& request)
      : request_(request),
        pixels_(from_bytes<float>(request.image())),
        mask_(from_bytes<float>(request.mask())) {}

  Photograph view() const {
    return {.width = static_cast<int>(request_.width()),
            .height = static_cast<int>(request_.height()),
            .channels = static_cast<int>(std::max(1U, request_.channels())),
            .pixels = pixels_,
            .mask = mask_};
  }

 private:
  const v1::PredictRequest& request_;
  std::vector<float> pixels_, mask_;
};

// Memory for one image: its message's arrays, and images of the crop at the photograph's own
// resolution; and for the network.
constexpr uint64_t kImages = 12;
constexpr uint64_t kPerPrediction = uint64_t{32} << 20;

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
    memory().resize(request_.image().size() * kImages + kPerPrediction);
    Predictor& predictor = service_.predictor_;
    const RequestPhotograph photograph(request_);
    return serialized(to_reply(predictor.estimate(photograph.view(), request_.capture(), stop),
                               predictor.version()));
  }

  std::string activity() const override { return "the prediction"; }

  PredictService& service_;
  v1::PredictRequest request_;
};

// One PredictBatch.
class PredictService::BatchCall final : public QueuedCall {
 public:
  BatchCall(PredictService& service, grpc::CallbackServerContext& context, grpc::ByteBuffer& reply)
      : QueuedCall(service.desk_, context, reply), service_(service) {}

 private:
  void accept(const grpc::ByteBuffer& bytes) override {
    parse_checked(bytes, "request", {{"itn.v1.PredictBatchRequest.images", kMaxBatchImages}},
                  request_);
    uint64_t pixels = 0;
    for (const v1::PredictRequest& image : request_.images()) {
      pixels += uint64_t{image.width()} * image.height();
    }
    if (request_.images_size() > 1 && pixels > service_.options_.max_pixels) {
      throw Error(ErrorKind::kLimit,
                  fmt::format("the {} images have {} pixels together; this predictor accepts {} at "
                              "a time: send fewer, or smaller ones",
                              request_.images_size(), pixels, service_.options_.max_pixels));
    }
  }

  grpc::ByteBuffer work(std::stop_token stop) override {
    memory().resize(memory_needed());
    Predictor& predictor = service_.predictor_;
    const auto seen = [&](size_t i) {
      const v1::PredictRequest& image = request_.images(static_cast<int>(i));
      check_sizes(image, service_.options_.max_pixels);
      return predictor.seen(RequestPhotograph(image).view(), image.capture(), stop);
    };
    return serialized(to_reply(predictor.estimate_each(static_cast<size_t>(request_.images_size()),
                                                       seen, request_.one_material(), stop),
                               predictor.version()));
  }

  // The messages stay; the rest is for one image after the other, but for what the network sees.
  uint64_t memory_needed() const {
    uint64_t all = 0, largest = 0;
    for (const v1::PredictRequest& image : request_.images()) {
      all += image.image().size() + image.mask().size();
      largest = std::max<uint64_t>(largest, image.image().size());
    }
    return all + largest * kImages + 2 * kPerPrediction;
  }

  std::string activity() const override { return "the prediction"; }

  PredictService& service_;
  v1::PredictBatchRequest request_;
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

grpc::ServerUnaryReactor* PredictService::PredictBatch(grpc::CallbackServerContext* context,
                                                       const grpc::ByteBuffer* request,
                                                       grpc::ByteBuffer* reply) {
  return start_call<BatchCall>(*context, request, *this, *context, *reply);
}

}  // namespace itn
