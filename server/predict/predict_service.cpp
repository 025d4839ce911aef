#include "server/predict/predict_service.h"

#include <fmt/format.h>

#include <stop_token>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/rpc/status.h"
#include "common/rpc/wire_array.h"

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
  const std::vector<Material> materials =
      predictor.predict({.width = static_cast<int>(request.width()),
                         .height = static_cast<int>(request.height()),
                         .channels = static_cast<int>(std::max(1U, request.channels())),
                         .pixels = pixels,
                         .mask = mask},
                        stop);
  v1::PredictReply reply;
  for (const Material& material : materials) {
    v1::Material& proto = *reply.add_materials();
    proto.set_sigma_t(material.sigma_t);
    proto.set_albedo(material.albedo);
    proto.set_g(material.g);
  }
  reply.set_model(predictor.name());
  return reply;
}

}  // namespace

// One Predict. Lives until gRPC is done with it; the last thing that each of our own threads does
// with it is to finish it.
class PredictService::PredictCall final : public grpc::ServerUnaryReactor {
 public:
  PredictCall(PredictService& service, const v1::PredictRequest& request, v1::PredictReply& reply)
      : service_(service), request_(request), reply_(reply) {
    try {
      check_sizes(request_, service_.options_.max_pixels);
      service_.queue_.submit(
          {stop_.get_token(), [this] { run(); }, [this] { Finish(grpc::Status::CANCELLED); }});
    } catch (...) {
      Finish(status_of_current_exception());
    }
  }

  void OnCancel() override {
    stop_.request_stop();
    service_.queue_.drop_stopped();
  }

  void OnDone() override { delete this; }

 private:
  // On the thread of the queue.
  void run() {
    grpc::Status status;
    try {
      reply_ = predict(service_.predictor_, request_, stop_.get_token());
    } catch (...) {
      status = status_of_current_exception();
    }
    Finish(status);
  }

  PredictService& service_;
  const v1::PredictRequest& request_;
  v1::PredictReply& reply_;
  std::stop_source stop_;
};

PredictService::PredictService(Predictor predictor, const PredictServiceOptions& options)
    : options_(options), predictor_(std::move(predictor)), queue_(1, options.queue_capacity) {}

grpc::ServerUnaryReactor* PredictService::Predict(grpc::CallbackServerContext* /*context*/,
                                                  const v1::PredictRequest* request,
                                                  v1::PredictReply* reply) {
  return new PredictCall(*this, *request, *reply);  // deletes itself in OnDone
}

}  // namespace itn
