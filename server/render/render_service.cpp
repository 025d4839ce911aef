#include "server/render/render_service.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <memory>
#include <stop_token>
#include <thread>
#include <utility>

#include "common/error.h"
#include "common/rpc/status.h"
#include "common/scene/scene_bytes.h"
#include "common/wire/wire_array.h"
#include "server/render/render_reply.h"
#include "server/render/weighted_image_loss.h"
#include "server/rpc/byte_buffer.h"
#include "server/tracer/scene/value.h"

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
      : QueuedCall(service.scheduler_, context, reply), service_(service) {}

 private:
  void accept(const grpc::ByteBuffer& bytes) override {
    parse_checked(bytes, "request", kElementLimits, request_);
    built_ = build_request(request_, service_.options_.limits);
    if (request_.scene().empty()) {
      scene_ = service_.cache_.find(key_of(request_.scene_digest()));
      if (!scene_ && !built_.values.empty()) {
        described_ = service_.cache_.find_described(request_.scene_digest());
      }
      if (!scene_ && !described_) throw scene_not_held(request_.scene_digest());
    }
    request_bytes_ = bytes.Length();
  }

  grpc::ByteBuffer work(std::stop_token stop) override {
    const SceneCache::ScenePtr scene = find_or_build_scene(stop);
    const RenderLimits& limits = service_.options_.limits;
    tracer::validate(built_.asked, *scene);
    const uint64_t gradient_numbers = tracer::gradient_numbers(built_.asked, *scene);
    check_reply_size(scene->width(), scene->height(), request_, limits, gradient_numbers);
    const uint64_t pixels = pixel_count(scene->width(), scene->height(), request_);
    check_time(pixels);
    memory().resize(request_bytes_);  // the scene counts by itself as far as its cache is too small
    memory().resize(request_bytes_ + film_memory(pixels, request_, built_.asked, gradient_numbers),
                    service_.cache_.excess_of(*scene));
    if (request_.has_loss() && built_.asked.pilot_spp > 0) {
      built_.asked.sampling_weights = loss_sampling_weights(
          from_bytes<float>(request_.loss().image()), from_bytes<float>(request_.loss().weight()));
    }
    phase_ = Phase::kRender;
    spdlog::debug("rendering {} of {}x{} pixels, {} spp", pixels, scene->width(), scene->height(),
                  built_.asked.sample_count);
    const tracer::FilmSums sums =
        tracer::render_grad(*scene, built_.asked, {.threads = service_.options_.threads}, stop);
    log(sums);
    paths_ = sums.counters.paths;
    return serialized(make_reply(sums, request_, built_.derivative_weights));
  }

  std::string_view method() const override { return "RenderGrad"; }
  double units() const override { return static_cast<double>(paths_); }
  std::string_view unit() const override { return "paths"; }

  std::string activity() const override {
    const Material& m = built_.asked.material;
    if (phase_ == Phase::kScene) return "building the scene";
    return fmt::format("rendering {} samples per pixel at sigma_t {:g}, albedo {:g}, g {:g}",
                       built_.asked.sample_count, m.sigma_t, m.albedo, m.g);
  }

  // Lets go of a scene that was found: it is in use until the render ends, not until the answer is
  // read.
  SceneCache::ScenePtr find_or_build_scene(const std::stop_token& stop) {
    if (scene_) return std::exchange(scene_, nullptr);
    if (const SceneCache::DescribedPtr described = std::exchange(described_, nullptr)) {
      const uint64_t copy = described->memory();
      memory().resize(request_bytes_ + copy);
      return service_.cache_.get_or_build(
          key_of(request_.scene_digest()),
          [&] { return build(described->description, request_bytes_ + copy, stop); }, stop);
    }
    const std::string digest = sha256(request_.scene());
    if (!request_.scene_digest().empty() && request_.scene_digest() != digest) {
      throw invalid_input("scene_digest is not the SHA-256 of scene; leave one of them out");
    }
    return service_.cache_.get_or_build(
        key_of(digest),
        [&] {
          SceneCache::ScenePtr scene = build(describe(stop), 3 * request_bytes_, stop);
          if (!built_.values.empty()) hold_description(digest, stop);
          return scene;
        },
        stop);
  }

  // The key of a scene with the values that are asked for.
  std::string key_of(const std::string& digest) const {
    std::string key = digest;
    for (const auto& [parameter, value] : built_.values) {
      key += part_key("", parameter.kind, parameter.index, parameter.slot, value);
    }
    return key;
  }

  tracer::SceneDescription describe(const std::stop_token& stop) {
    memory().resize(3 * request_bytes_);  // the request, the scene's message, its arrays
    const v1::Scene message = parse_scene(request_.scene());
    return build_scene(message, service_.options_.limits, &service_.cache_.parts(), stop);
  }

  // For requests with other values. As its object was compiled just now, it is not in there twice.
  void hold_description(const std::string& digest, const std::stop_token& stop) {
    service_.cache_.get_or_describe(
        digest,
        [&] {
          return std::make_shared<const SceneCache::Described>(
              SceneCache::Described{describe(stop)});
        },
        stop);
  }

  // `held`: bytes beside what is compiled.
  SceneCache::ScenePtr build(tracer::SceneDescription description, uint64_t held,
                             const std::stop_token& stop) {
    for (const auto& [parameter, value] : built_.values) {
      tracer::set_value(parameter, value, description);
    }
    memory().resize(held + tracer::estimated_memory(description));
    return std::make_shared<const tracer::Scene>(std::move(description), service_.cache_.parts(),
                                                 stop);
  }

  // Nothing traces paths faster than this, whatever it traces them through.
  void check_time(uint64_t pixels) const {
    constexpr double kPathsPerThreadSecond = 1e8;
    const double most = service_.options_.max_seconds;
    const double paths = static_cast<double>(pixels) * built_.asked.sample_count;
    const double least = paths / (kPathsPerThreadSecond * service_.options_.threads);
    if (most > 0 && built_.asked.pixels == tracer::Pixels::kAll && least > most) {
      throw Error(
          ErrorKind::kLimit,
          fmt::format("{} samples of {} pixels take more than {:.0f} s; this worker gives a "
                      "request {:g} s (--max-seconds): ask for fewer at a time",
                      built_.asked.sample_count, pixels, least, most));
    }
  }

  void log(const tracer::FilmSums& sums) const {
    const Material& m = built_.asked.material;
    const tracer::Counters& counters = sums.counters;
    spdlog::debug("rendered {}x{}, {} spp, sigma_t {} albedo {} g {}: {:.2f} CPU-seconds, {} leaks",
                  sums.width, sums.height, built_.asked.sample_count, m.sigma_t, m.albedo, m.g,
                  counters.cpu_seconds, counters.leaks);
    if (counters.invalid_samples > 0) {
      spdlog::warn("dropped {} invalid samples of {} paths (seed {}, sigma_t {}, albedo {}, g {})",
                   counters.invalid_samples, counters.paths, built_.asked.seed, m.sigma_t, m.albedo,
                   m.g);
    }
  }

  enum class Phase { kScene, kRender };

  RenderService& service_;
  v1::RenderGradRequest request_;
  uint64_t request_bytes_ = 0;
  // The scene of a request that waits and names one: it stays until then.
  SceneCache::ScenePtr scene_;
  SceneCache::DescribedPtr described_;
  BuiltRequest built_;
  uint64_t paths_ = 0;
  std::atomic<Phase> phase_ = Phase::kScene;
};

RenderService::RenderService(const RenderServiceOptions& options)
    : options_(with_defaults(options)),
      cache_(options_.cache_bytes),
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
