#include "server/predict/predict_service.h"

#include <fmt/format.h>

#include <algorithm>
#include <stop_token>
#include <utility>
#include <variant>
#include <vector>

#include "common/error.h"
#include "common/learning/predict_reply.h"
#include "common/printable.h"
#include "common/scene/wire_array.h"
#include "server/rpc/byte_buffer.h"

namespace itn {
namespace {

size_t channels_of(const v1::PredictRequest& request) {
  return std::max(1U, request.channels());
}

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
  check_bytes("image", request.image(), pixels * channels_of(request));
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
            .channels = static_cast<int>(channels_of(request_)),
            .pixels = pixels_,
            .mask = mask_};
  }

 private:
  const v1::PredictRequest& request_;
  std::vector<float> pixels_, mask_;
};

v1::ListedModel to_proto(const ServedModel& served) {
  const v1::Model& model = served.predictor->model();
  v1::ListedModel listed;
  listed.set_name(served.name);
  listed.set_version(served.version);
  listed.set_by_default(served.by_default);
  *listed.mutable_model() = served.predictor->version();
  listed.set_title(printable(served.title, 200));
  listed.set_resolution(model.resolution());
  listed.set_exposure_known(model.exposure() != v1::EXPOSURE_UNKNOWN);
  listed.set_sigma_t_min(model.bounds().sigma_t().min());
  listed.set_sigma_t_max(model.bounds().sigma_t().max());
  listed.set_albedo_min(model.bounds().albedo().min());
  listed.set_albedo_max(model.bounds().albedo().max());
  listed.set_g_min(model.bounds().g().min());
  listed.set_g_max(model.bounds().g().max());
  listed.set_intervals(model.output() == v1::GAUSSIAN);
  return listed;
}

// Memory for one photograph: its message's arrays, and images of the crop at the photograph's own
// resolution.
constexpr uint64_t kImages = 12;
// What the networks take, one after the other.
constexpr uint64_t kNetworkBytes = uint64_t{32} << 20;

// What is made of photographs for the network, until it has seen them: planes of its resolution.
uint64_t bytes_of_inputs(const Predictor& predictor, int64_t images) {
  constexpr int64_t kMaxChannels = 3;
  const int64_t planes = 20 * static_cast<int64_t>(predictor.channels());
  const int64_t side = predictor.model().resolution();
  const int64_t at_once =
      std::min(images * kMaxChannels, predictor.inputs_at_a_time() + kMaxChannels);
  return static_cast<uint64_t>(at_once * side * side * planes) * sizeof(float);
}

uint64_t bytes_of(const v1::PredictRequest& request) {
  return request.image().size() + request.mask().size();
}

}  // namespace

// What both calls have in common. The model is the one that was served when the call was accepted.
class PredictService::Call : public QueuedCall {
 public:
  Call(PredictService& service, grpc::CallbackServerContext& context, grpc::ByteBuffer& reply)
      : QueuedCall(service.scheduler_, context, reply), service_(service) {}

 protected:
  // `channels`: of the image, which tell which model where none is named.
  template <typename Request>
  void find_model(const Request& request, size_t channels) {
    predictor_ = service_.models_->find(request.model(), request.version(), channels);
  }

  // `kept`: bytes of all that the call holds beside.
  NetworkView seen(const v1::PredictRequest& image, uint64_t kept, const std::stop_token& stop) {
    const std::lock_guard one_at_a_time(service_.preparing_);
    memory().resize(kept + image.image().size() * kImages);
    NetworkView result = predictor_->seen(RequestPhotograph(image).view(), image.capture(), stop);
    memory().resize(kept);
    return result;
  }

  Predictor::Embed through_network(const std::stop_token& stop) {
    return [this, stop](const torch::Tensor& input) {
      return service_.network_.embed(*predictor_, input, stop);
    };
  }

  std::string activity() const override { return "the prediction"; }
  std::string_view unit() const override { return "images"; }

  uint64_t max_pixels() const { return service_.options_.max_pixels; }
  const Predictor& predictor() const { return *predictor_; }

  virtual grpc::ByteBuffer answer(const std::stop_token& stop) = 0;

 private:
  // The model goes when it has answered: gRPC may keep the call for longer.
  grpc::ByteBuffer work(std::stop_token stop) final {
    const std::shared_ptr<void> afterwards(nullptr, [this](void*) { predictor_.reset(); });
    return answer(stop);
  }

  PredictService& service_;
  std::shared_ptr<const Predictor> predictor_;
};

// One Predict.
class PredictService::PredictCall final : public Call {
 public:
  using Call::Call;

 private:
  std::string_view method() const override { return "Predict"; }
  double units() const override { return 1; }

  void accept(const grpc::ByteBuffer& bytes) override {
    parse_checked(bytes, "request", {}, request_);
    check_sizes(request_, max_pixels());
    find_model(request_, channels_of(request_));
  }

  grpc::ByteBuffer answer(const std::stop_token& stop) override {
    const uint64_t kept = bytes_of(request_) + bytes_of_inputs(predictor(), 1);
    const auto see = [&](size_t) { return seen(request_, kept, stop); };
    const Predictor::Outcome outcome = std::move(
        predictor().estimate_each(1, see, false, stop, through_network(stop)).each.front());
    if (const Error* error = std::get_if<Error>(&outcome)) throw *error;
    return serialized(
        to_reply(std::get<std::vector<MaterialEstimate>>(outcome), predictor().version()));
  }

  v1::PredictRequest request_;
};

// One PredictBatch.
class PredictService::BatchCall final : public Call {
 public:
  using Call::Call;

 private:
  std::string_view method() const override { return "PredictBatch"; }
  double units() const override { return request_.images_size(); }

  void accept(const grpc::ByteBuffer& bytes) override {
    parse_checked(bytes, "request", {{"itn.v1.PredictBatchRequest.images", kMaxBatchImages}},
                  request_);
    uint64_t pixels = 0;
    for (const v1::PredictRequest& image : request_.images()) {
      pixels += uint64_t{image.width()} * image.height();
    }
    if (request_.images_size() > 1 && pixels > max_pixels()) {
      throw Error(ErrorKind::kLimit,
                  fmt::format("the {} images have {} pixels together; this predictor accepts {} at "
                              "a time: send fewer, or smaller ones",
                              request_.images_size(), pixels, max_pixels()));
    }
    find_model(request_, request_.images().empty() ? 1 : channels_of(request_.images(0)));
  }

  grpc::ByteBuffer answer(const std::stop_token& stop) override {
    uint64_t kept = bytes_of_inputs(predictor(), request_.images_size());
    for (const v1::PredictRequest& image : request_.images()) kept += bytes_of(image);
    memory().resize(kept);
    const auto see = [&](size_t i) {
      const v1::PredictRequest& image = request_.images(static_cast<int>(i));
      check_sizes(image, max_pixels());
      if (!image.model().empty() || !image.version().empty()) {
        throw invalid_input("an image of a batch names a model; name it once, for the batch");
      }
      return seen(image, kept, stop);
    };
    return serialized(
        to_reply(predictor().estimate_each(static_cast<size_t>(request_.images_size()), see,
                                           request_.one_material(), stop, through_network(stop)),
                 predictor().version()));
  }

  v1::PredictBatchRequest request_;
};

PredictService::PredictService(std::shared_ptr<const ModelStore> models,
                               const PredictServiceOptions& options)
    : options_(options),
      models_(std::move(models)),
      network_(options.max_batch),
      scheduler_(
          {.threads = options.max_batch,
           .queue_capacity = options.queue_capacity,
           .memory_bytes = options.memory_bytes > 0 ? options.memory_bytes - kNetworkBytes : 0,
           .max_time = std::chrono::seconds(0),
           .log_calls = options.log_calls}) {}

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

grpc::ServerUnaryReactor* PredictService::ListModels(grpc::CallbackServerContext* context,
                                                     const grpc::ByteBuffer* request,
                                                     grpc::ByteBuffer* reply) {
  return answer_at_once(*context, [&] {
    v1::ListModelsRequest nothing;
    parse_checked(*request, "request", {}, nothing);
    v1::ListModelsReply list;
    for (const ServedModel& model : models_->models()) *list.add_models() = to_proto(model);
    *reply = serialized(list);
  });
}

}  // namespace itn
