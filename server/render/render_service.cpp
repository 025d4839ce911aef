#include "server/render/render_service.h"

#include <spdlog/spdlog.h>

#include <memory>
#include <stop_token>
#include <thread>
#include <utility>

#include "common/error.h"
#include "common/rpc/status.h"
#include "server/rpc/byte_buffer.h"

namespace itn {
namespace {

RenderServiceOptions with_defaults(RenderServiceOptions options) {
  if (options.threads <= 0) {
    options.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  }
  return options;
}

// More than the checks of the request let pass; they say it better.
const ElementLimits kElementLimits = {{"itn.v1.RenderGradRequest.albedos", 1024},
                                      {"itn.v1.RenderGradRequest.derivatives", 1024},
                                      {"itn.v1.RenderGradRequest.parameters", 1024},
                                      {"itn.v1.RenderGradRequest.scene_derivatives", 1024},
                                      {"itn.v1.RenderGradRequest.values", 1024}};

StatusError scene_not_held(const std::string& digest) {
  v1::SceneNotHeld details;
  details.set_scene_digest(digest);
  return StatusError({grpc::StatusCode::FAILED_PRECONDITION,
                      "this worker does not hold the scene of this digest: send the scene",
                      details.SerializeAsString()});
}

}  // namespace

// One RenderGrad.
class RenderService::RenderCall final : public QueuedCall {
 public:
  RenderCall(RenderService& service, grpc::CallbackServerContext& context, grpc::ByteBuffer& reply)
      : QueuedCall(service.scheduler_, context, reply),
        render_(service.means_,
                [this](uint64_t bytes, uint64_t beside) { memory().resize(bytes, beside); }) {}

 private:
  void accept(const grpc::ByteBuffer& bytes) override {
    v1::RenderGradRequest request;
    parse_checked(bytes, "request", kElementLimits, request);
    if (!render_.accept(std::move(request), bytes.Length())) {
      throw scene_not_held(render_.request().scene_digest());
    }
  }

  grpc::ByteBuffer work(std::stop_token stop) override { return serialized(render_.render(stop)); }

  std::string_view method() const override { return "RenderGrad"; }
  double units() const override { return static_cast<double>(render_.paths()); }
  std::string_view unit() const override { return "paths"; }
  std::string activity() const override { return render_.activity(); }

  RequestRender render_;
};

RenderService::RenderService(const RenderServiceOptions& options)
    : options_(with_defaults(options)),
      cache_(options_.cache_bytes),
      means_{.limits = options_.limits,
             .threads = options_.threads,
             .max_seconds = options_.max_seconds,
             .cache = cache_},
      scheduler_({.threads = options_.renders,
                  .queue_capacity = options_.queue_capacity,
                  .memory_bytes = options_.memory_bytes,
                  .memory_beside = [this] { return cache_.excess(); },
                  .max_time = std::chrono::duration<double>(options_.max_seconds),
                  .log_calls = options_.log_calls}) {}

grpc::ServerUnaryReactor* RenderService::RenderGrad(grpc::CallbackServerContext* context,
                                                    const grpc::ByteBuffer* request,
                                                    grpc::ByteBuffer* reply) {
  return start_call<RenderCall>(*context, request, *this, *context, *reply);
}

grpc::ServerUnaryReactor* RenderService::GetCapabilities(grpc::CallbackServerContext* context,
                                                         const grpc::ByteBuffer* request,
                                                         grpc::ByteBuffer* reply) {
  return answer_at_once(*context, [&] {
    v1::GetCapabilitiesRequest nothing;
    parse_checked(*request, "request", kElementLimits, nothing);
    const RenderLimits& limits = options_.limits;
    v1::Capabilities capabilities;
    capabilities.set_version(ITN_VERSION);
    capabilities.set_threads(static_cast<uint32_t>(options_.threads));
    capabilities.set_max_pixels(limits.max_pixels);
    capabilities.set_max_spp(limits.max_spp);
    capabilities.set_max_triangles(limits.max_triangles);
    capabilities.set_max_message_bytes(limits.max_message_bytes);
    capabilities.set_queue_capacity(static_cast<uint32_t>(options_.queue_capacity));
    *reply = serialized(capabilities);
  });
}

}  // namespace itn
