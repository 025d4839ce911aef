#include "client/predict/predictors.h"

#include <spdlog/spdlog.h>

#include <map>
#include <memory>
#include <utility>

#include "client/interrupt.h"
#include "client/predict/predictor_error.h"
#include "client/rpc/channel.h"
#include "client/rpc/deadline.h"
#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/model_files.h"
#include "common/learning/predict_reply.h"
#include "common/learning/predictor.h"
#include "common/rpc/request_id.h"
#include "common/rpc/status.h"
#include "common/scene/wire_array.h"
#include "itn/v1/predict.grpc.pb.h"

namespace itn {
namespace {

v1::PredictRequest request_of(const PredictInput& input) {
  const FramedPhotograph& photograph = input.photograph;
  v1::PredictRequest request;
  request.set_width(static_cast<uint32_t>(photograph.side));
  request.set_height(static_cast<uint32_t>(photograph.side));
  request.set_channels(static_cast<uint32_t>(photograph.channels));
  request.set_image(to_bytes(photograph.pixels));
  request.set_mask(to_bytes(photograph.mask));
  *request.mutable_capture() = input.capture;
  return request;
}

// Each photograph by itself: those in a row of which `key_of` says the same are asked about
// together, by ask(key, photographs).
template <typename KeyOf, typename Ask>
v1::PredictBatchReply asked_in_rows(std::span<const PredictInput> photographs, const KeyOf& key_of,
                                    const Ask& ask) {
  v1::PredictBatchReply reply;
  while (!photographs.empty()) {
    const auto key = key_of(photographs.front());
    size_t count = 1;
    while (count < photographs.size() && key_of(photographs[count]) == key) ++count;
    reply.MergeFrom(ask(key, photographs.first(count)));
    photographs = photographs.subspan(count);
  }
  return reply;
}

class RemotePredictor {
 public:
  RemotePredictor(std::string address, const ClientSecurity& security,
                  std::chrono::milliseconds timeout, std::string model, std::string version)
      : address_(std::move(address)),
        timeout_(timeout),
        model_(std::move(model)),
        version_(std::move(version)),
        connector_(security),
        stub_(v1::PredictService::NewStub(connector_.connect_to(address_))) {}

  // A predictor that is asked for no model chooses one by the channels.
  v1::PredictBatchReply operator()(std::span<const PredictInput> photographs,
                                   bool one_material) const {
    if (one_material || !model_.empty()) return asked(photographs, one_material);
    return asked_in_rows(
        photographs, [](const PredictInput& photograph) { return photograph.channels.size(); },
        [this](size_t, std::span<const PredictInput> row) { return asked(row, false); });
  }

 private:
  v1::PredictBatchReply asked(std::span<const PredictInput> photographs, bool one_material) const {
    v1::PredictBatchReply reply;
    if (photographs.size() == 1 && !one_material) {
      v1::PredictOutcome& outcome = *reply.add_outcomes();
      const Ended call = made(&v1::PredictService::Stub::Predict,
                              for_model(request_of(photographs.front())), *outcome.mutable_reply());
      if (!is_of_the_photograph(call.status)) {
        require_ok(call);
        return reply;
      }
      spdlog::warn("{} refuses the photograph (request {})", address_, call.name);
      outcome.clear_reply();
      outcome.set_code(call.status.error_code());
      outcome.set_message(message_of(call.status));
      return reply;
    }
    v1::PredictBatchRequest request;
    request.set_one_material(one_material);
    for (const PredictInput& photograph : photographs) {
      *request.add_images() = request_of(photograph);
    }
    const Ended call =
        made(&v1::PredictService::Stub::PredictBatch, for_model(std::move(request)), reply);
    if (call.status.error_code() != grpc::StatusCode::RESOURCE_EXHAUSTED || one_material) {
      require_ok(call);
      return reply;
    }
    // More than it takes at a time.
    const size_t half = photographs.size() / 2;
    reply = asked(photographs.first(half), false);
    reply.MergeFrom(asked(photographs.subspan(half), false));
    return reply;
  }

  struct Ended {
    grpc::Status status;
    std::string name;  // of the request, in the predictor's log
  };

  template <typename Method, typename Request, typename Reply>
  Ended made(Method method, const Request& request, Reply& reply) const {
    grpc::ClientContext context;
    context.set_deadline(deadline_in(timeout_));
    const std::string name = assign_request_id(context);
    return {((*stub_).*method)(&context, request, &reply), name};
  }

  template <typename Request>
  Request for_model(Request request) const {
    request.set_model(model_);
    request.set_version(version_);
    return request;
  }

  // Others could still be answered.
  static bool is_of_the_photograph(const grpc::Status& status) {
    return status.error_code() == grpc::StatusCode::INVALID_ARGUMENT ||
           status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED;
  }

  void require_ok(const Ended& call) const {
    if (call.status.ok()) return;
    throw predictor_error(with_request_id(connector_.with_cause(call.status, address_), call.name),
                          address_);
  }

  std::string address_;
  std::chrono::milliseconds timeout_;
  std::string model_, version_;
  Connector connector_;
  std::shared_ptr<v1::PredictService::Stub> stub_;
};

}  // namespace

Predict predictor_here(const std::filesystem::path& model) {
  set_torch_threads(1);
  const auto predictor = std::make_shared<Predictor>(Predictor::load(model));
  return [predictor](std::span<const PredictInput> photographs, bool one_material) {
    const auto seen = [&](size_t i) {
      return predictor->seen(photographs[i].photograph.view(), photographs[i].capture,
                             interruption());
    };
    return to_reply(
        predictor->estimate_each(photographs.size(), seen, one_material, interruption()),
        predictor->version());
  };
}

Predict predictor_here(const ModelOf& model_of) {
  const auto loaded = std::make_shared<std::map<std::string, Predict>>();
  const auto predict_by = [loaded](const std::string& model) -> const Predict& {
    Predict& predict = (*loaded)[model];
    if (!predict) predict = predictor_here(find_model("", model));
    return predict;
  };
  return [=](std::span<const PredictInput> photographs, bool one_material) {
    if (one_material) return predict_by(model_of(photographs.front()))(photographs, true);
    return asked_in_rows(photographs, model_of,
                         [&](const std::string& model, std::span<const PredictInput> row) {
                           return predict_by(model)(row, false);
                         });
  };
}

v1::MaterialRange range_of_model(const std::filesystem::path& model) {
  return read_checkpoint(model).model().bounds();
}

Predict predictor_at(const std::string& address, const ClientSecurity& security,
                     std::chrono::milliseconds timeout, const std::string& model,
                     const std::string& version) {
  return RemotePredictor(address, security, timeout, model, version);
}

}  // namespace itn
