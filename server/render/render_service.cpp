#include "server/render/render_service.h"

#include <spdlog/spdlog.h>

#include <exception>
#include <memory>
#include <stop_token>
#include <thread>
#include <utility>

#include "common/error.h"
#include "common/rpc/status.h"
#include "common/rpc/wire_array.h"
#include "common/scene/scene_bytes.h"
#include "server/render/render_reply.h"
#include "server/render/rendering_loss.h"

namespace itn {
namespace {

RenderServiceOptions with_defaults(RenderServiceOptions options) {
  if (options.threads <= 0) {
    options.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  }
  return options;
}

grpc::Status scene_not_held(const std::string& digest) {
  v1::SceneNotHeld details;
  details.set_scene_digest(digest);
  return {grpc::StatusCode::FAILED_PRECONDITION,
          "this worker does not hold the scene of this digest: send the scene",
          details.SerializeAsString()};
}

}  // namespace

// One RenderGrad. Lives until gRPC is done with it; the last thing that each of our own threads
// does with it is to finish it.
class RenderService::RenderCall final : public grpc::ServerUnaryReactor {
 public:
  RenderCall(RenderService& service, const v1::RenderGradRequest& request,
             v1::RenderGradReply& reply)
      : service_(service), request_(request), reply_(reply) {
    try {
      start();
    } catch (...) {
      Finish(status_of_current_exception());
    }
  }

  // By the client, by a lost connection, or because the deadline has passed.
  void OnCancel() override {
    stop_.request_stop();
    service_.queue_.drop_stopped();
  }

  void OnDone() override { delete this; }

 private:
  // On a thread of gRPC: checks what is quickly checked and enqueues the rest.
  void start() {
    asked_ = build_request(request_, service_.options_.limits);
    if (request_.scene().empty()) {
      scene_ = service_.cache_.find(request_.scene_digest());
      if (!scene_) {
        Finish(scene_not_held(request_.scene_digest()));
        return;
      }
    }
    service_.queue_.submit(
        {stop_.get_token(), [this] { run(); }, [this] { Finish(grpc::Status::CANCELLED); }});
  }

  // On a thread of the queue.
  void run() {
    grpc::Status status;
    try {
      render();
    } catch (...) {
      status = status_of_current_exception();
      spdlog::debug("render failed: {}", status.error_message());
    }
    Finish(status);
  }

  void render() {
    if (!scene_) scene_ = service_.scene_of(request_);
    check_reply_size(scene_->width(), scene_->height(), request_, service_.options_.limits);
    if (request_.has_loss() && asked_.pilot_spp > 0) {
      asked_.sampling_weights = loss_sampling_weights(from_bytes<float>(request_.loss().image()),
                                                      from_bytes<float>(request_.loss().weight()));
    }
    spdlog::debug("rendering {}x{}, samples [{}, {})", scene_->width(), scene_->height(),
                  asked_.first_sample, asked_.first_sample + asked_.sample_count);
    const tracer::FilmSums sums = tracer::render_grad(
        *scene_, asked_, {.threads = service_.options_.threads}, stop_.get_token());
    reply_ = make_reply(sums, request_);
    log(sums);
  }

  void log(const tracer::FilmSums& sums) const {
    const Material& m = asked_.material;
    const tracer::Counters& counters = sums.counters;
    spdlog::debug(
        "rendered {}x{}, samples [{}, {}), sigma_t {} albedo {} g {}: {:.2f} CPU-seconds, {} leaks",
        sums.width, sums.height, asked_.first_sample, asked_.first_sample + asked_.sample_count,
        m.sigma_t, m.albedo, m.g, counters.cpu_seconds, counters.leaks);
    if (counters.invalid_samples > 0) {
      spdlog::warn("dropped {} invalid samples of {} paths (seed {}, sigma_t {}, albedo {}, g {})",
                   counters.invalid_samples, counters.paths, asked_.seed, m.sigma_t, m.albedo, m.g);
    }
  }

  RenderService& service_;
  const v1::RenderGradRequest& request_;
  v1::RenderGradReply& reply_;
  tracer::RenderRequest asked_;
  SceneCache::ScenePtr scene_;
  std::stop_source stop_;
};

RenderService::RenderService(const RenderServiceOptions& options)
    : options_(with_defaults(options)),
      cache_(options_.cache_bytes),
      queue_(options_.renders, options_.queue_capacity) {}

grpc::ServerUnaryReactor* RenderService::RenderGrad(grpc::CallbackServerContext* /*context*/,
                                                    const v1::RenderGradRequest* request,
                                                    v1::RenderGradReply* reply) {
  return new RenderCall(*this, *request, *reply);  // deletes itself in OnDone
}

grpc::ServerUnaryReactor* RenderService::GetCapabilities(
    grpc::CallbackServerContext* context, const v1::GetCapabilitiesRequest* /*request*/,
    v1::Capabilities* reply) {
  const RenderLimits& limits = options_.limits;
  reply->set_version(ITN_VERSION);
  reply->set_threads(static_cast<uint32_t>(options_.threads));
  reply->set_max_pixels(limits.max_pixels);
  reply->set_max_spp(limits.max_spp);
  reply->set_max_triangles(limits.max_triangles);
  reply->set_max_message_bytes(limits.max_message_bytes);
  reply->set_queue_capacity(static_cast<uint32_t>(options_.queue_capacity));
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

SceneCache::ScenePtr RenderService::scene_of(const v1::RenderGradRequest& request) {
  const std::string digest = sha256(request.scene());
  if (!request.scene_digest().empty() && request.scene_digest() != digest) {
    throw invalid_input("scene_digest is not the SHA-256 of scene; leave one of them out");
  }
  return cache_.get_or_build(digest, [&] {
    return std::make_shared<const tracer::Scene>(
        build_scene(parse_scene(request.scene()), options_.limits));
  });
}

}  // namespace itn
