// The bytes of a RenderGrad, through the service as a client's come: parsed, checked, its scene
// built, rendered within small limits, answered. What is answered must pass the client's check.
#include <spdlog/spdlog.h>

#include <memory>
#include <utility>

#include "client/render_pool/reply_check.h"
#include "itn/v1/render.pb.h"
#include "server/render/render_server.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/message_mutation.h"
#include "tests/support/raw_call.h"

namespace itn {
namespace {

std::unique_ptr<RenderServer> small_server() {
  spdlog::set_level(spdlog::level::off);
  RenderServerOptions options;
  options.service.threads = 1;
  options.service.cache_bytes = size_t{1} << 20;
  options.service.memory_bytes = uint64_t{64} << 20;
  options.service.max_seconds = 2;
  options.service.limits = {
      .max_pixels = 1024, .max_spp = 4, .max_triangles = 4096, .max_message_bytes = 1U << 20};
  return std::make_unique<RenderServer>(options);
}

void check_answer(const std::string& request_bytes, const std::string& reply_bytes) {
  RenderJob job;
  v1::RenderGradReply reply;
  v1::Scene scene;
  if (!job.request.ParseFromString(request_bytes) || !reply.ParseFromString(reply_bytes)) {
    testing::fail("what was answered is no request, or the answer is no reply");
  }
  if (!scene.ParseFromString(job.request.scene())) testing::fail("what was rendered is no scene");
  SerializedScene sent;
  sent.width = scene.film().width();
  sent.height = scene.film().height();
  job.scene = std::make_shared<const SerializedScene>(std::move(sent));
  check_reply(reply, job);
}

}  // namespace
}  // namespace itn

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  static const std::unique_ptr<RenderServer> server = small_server();
  static const auto channel = server->in_process_channel();
  const std::string request = testing::to_string(data, size);
  const testing::RawAnswer answer =
      testing::call_with_bytes(channel, "/itn.v1.RenderService/RenderGrad", request);
  testing::expect_answer([&] {
    switch (answer.status.error_code()) {
      case grpc::StatusCode::OK: return check_answer(request, answer.reply);
      case grpc::StatusCode::INVALID_ARGUMENT:
      case grpc::StatusCode::FAILED_PRECONDITION:
      case grpc::StatusCode::RESOURCE_EXHAUSTED: throw invalid_input(answer.status.error_message());
      default: testing::fail("RenderGrad: " + answer.status.error_message());
    }
  });
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  using namespace itn;
  static const auto change = testing::change_serialized<v1::RenderGradRequest>(
      {{"itn.v1.RenderGradRequest.scene", &v1::Scene::default_instance()}});
  return testing::mutated_input(data, size, max_size, seed, change);
}
