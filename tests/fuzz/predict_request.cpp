// The bytes of a Predict and of a PredictBatch, through the service as a client's come, with small
// networks. Every number that is answered must be finite.
#include <spdlog/spdlog.h>

#include <memory>

#include "common/learning/checkpoint.h"
#include "common/scene/field_check.h"
#include "itn/v1/predict.pb.h"
#include "server/predict/predict_server.h"
#include "tests/common/learning/familiar_model.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/message_mutation.h"
#include "tests/support/raw_call.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

std::unique_ptr<PredictServer> small_server() {
  spdlog::set_level(spdlog::level::off);
  set_torch_threads(1);
  const testing::TemporaryFolder folder;
  const auto written = [&](const std::string& name, const v1::Model& model) {
    v1::Checkpoint checkpoint;
    *checkpoint.mutable_model() = model;
    write_checkpoint(folder.path(name + ".itn"), checkpoint);
    return name + "=" + folder.path(name + ".itn");
  };
  const auto models = std::make_shared<const ModelStore>(
      ModelStoreOptions{.models = {written("point", small_model()),
                                   written("gaussian", model_with_outlier_model(discs, 16))},
                        .folder = {}});
  PredictServerOptions options;
  options.service = {
      .max_pixels = 4096, .queue_capacity = 4, .max_batch = 1, .memory_bytes = uint64_t{128} << 20};
  return std::make_unique<PredictServer>(models, options);
}

template <typename Reply>
void expect_numbers(const std::string& method, const std::string& request) {
  static const std::unique_ptr<PredictServer> server = small_server();
  static const auto channel = server->in_process_channel();
  const testing::RawAnswer answer =
      testing::call_with_bytes(channel, "/itn.v1.PredictService/" + method, request);
  testing::expect_answer([&] {
    Reply reply;
    switch (answer.status.error_code()) {
      case grpc::StatusCode::OK: break;
      case grpc::StatusCode::INVALID_ARGUMENT:
      case grpc::StatusCode::NOT_FOUND:
      case grpc::StatusCode::RESOURCE_EXHAUSTED: throw invalid_input(answer.status.error_message());
      default: testing::fail(method + ": " + answer.status.error_message());
    }
    if (!reply.ParseFromString(answer.reply)) testing::fail(method + ": the answer is no reply");
    try {
      check_message(reply, "reply");
    } catch (const Error& error) {
      testing::fail(method + ": " + error.what());
    }
  });
}

}  // namespace
}  // namespace itn

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  const std::string request = testing::to_string(data, size);
  expect_numbers<v1::PredictReply>("Predict", request);
  expect_numbers<v1::PredictBatchReply>("PredictBatch", request);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  using namespace itn;
  static const auto one = testing::change_serialized<v1::PredictRequest>();
  static const auto batch = testing::change_serialized<v1::PredictBatchRequest>();
  return testing::mutated_input(data, size, max_size, seed,
                                [](const std::string& input, std::mt19937& random) {
                                  auto changed = one(input, random);
                                  return changed ? changed : batch(input, random);
                                });
}
