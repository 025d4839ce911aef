#include "server/render/request_render.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <memory>
#include <utility>

#include "common/error.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"
#include "server/render/render_reply.h"
#include "server/render/weighted_image_loss.h"
#include "server/tracer/scene/value.h"

namespace itn {

RequestRender::RequestRender(const RenderMeans& means, Reserve reserve)
    : means_(means), reserve_(std::move(reserve)) {}

bool RequestRender::accept(v1::RenderGradRequest request, uint64_t bytes) {
  request_ = std::move(request);
  request_bytes_ = bytes;
  built_ = build_request(request_, means_.limits);
  if (!request_.scene().empty()) return true;
  scene_ = means_.cache.find(key_of(request_.scene_digest()));
  if (!scene_ && !built_.values.empty()) {
    described_ = means_.cache.find_described(request_.scene_digest());
  }
  return scene_ || described_;
}

v1::RenderGradReply RequestRender::render(const std::stop_token& stop) {
  const SceneCache::ScenePtr scene = find_or_build_scene(stop);
  tracer::validate(built_.asked, *scene);
  const uint64_t gradient_numbers = tracer::gradient_numbers(built_.asked, *scene);
  check_reply_size(scene->width(), scene->height(), request_, means_.limits, gradient_numbers);
  const uint64_t pixels = pixel_count(scene->width(), scene->height(), request_);
  check_time(pixels);
  reserve_(request_bytes_, 0);  // the scene counts by itself as far as its cache is too small
  reserve_(request_bytes_ + film_memory(pixels, request_, built_.asked, gradient_numbers),
           means_.cache.excess_of(*scene));
  if (request_.has_loss() && built_.asked.pilot_spp > 0) {
    built_.asked.sampling_weights = loss_sampling_weights(
        from_bytes<float>(request_.loss().image()), from_bytes<float>(request_.loss().weight()));
  }
  has_scene_ = true;
  spdlog::debug("rendering {} of {}x{} pixels, {} spp", pixels, scene->width(), scene->height(),
                built_.asked.sample_count);
  const tracer::FilmSums sums =
      tracer::render_grad(*scene, built_.asked, {.threads = means_.threads}, stop);
  log(sums);
  paths_ = sums.counters.paths;
  return make_reply(sums, request_, built_.derivative_weights);
}

std::string RequestRender::activity() const {
  if (!has_scene_) return "building the scene";
  const Material& m = built_.asked.material;
  return fmt::format("rendering {} samples per pixel at sigma_t {:g}, albedo {:g}, g {:g}",
                     built_.asked.sample_count, m.sigma_t, m.albedo, m.g);
}

// Lets go of a scene that was found: it is in use until the render ends, not until the answer is
// read.
SceneCache::ScenePtr RequestRender::find_or_build_scene(const std::stop_token& stop) {
  if (scene_) return std::exchange(scene_, nullptr);
  if (const SceneCache::DescribedPtr described = std::exchange(described_, nullptr)) {
    const uint64_t copy = described->memory();
    reserve_(request_bytes_ + copy, 0);
    return means_.cache.get_or_build(
        key_of(request_.scene_digest()),
        [&] { return build(described->description, request_bytes_ + copy, stop); }, stop);
  }
  const std::string digest = sha256(request_.scene());
  if (!request_.scene_digest().empty() && request_.scene_digest() != digest) {
    throw invalid_input("scene_digest is not the SHA-256 of scene; leave one of them out");
  }
  return means_.cache.get_or_build(
      key_of(digest),
      [&] {
        SceneCache::ScenePtr scene = build(describe(stop), 3 * request_bytes_, stop);
        if (!built_.values.empty()) hold_description(digest, stop);
        return scene;
      },
      stop);
}

// The key of a scene with the values that are asked for.
std::string RequestRender::key_of(const std::string& digest) const {
  std::string key = digest;
  for (const auto& [parameter, value] : built_.values) {
    key += part_key("", parameter.kind, parameter.index, parameter.slot, value);
  }
  return key;
}

tracer::SceneDescription RequestRender::describe(const std::stop_token& stop) {
  reserve_(3 * request_bytes_, 0);  // the request, the scene's message, its arrays
  const v1::Scene message = parse_scene(request_.scene());
  return build_scene(message, means_.limits, &means_.cache.parts(), stop);
}

// For requests with other values. As its object was compiled just now, it is not in there twice.
void RequestRender::hold_description(const std::string& digest, const std::stop_token& stop) {
  means_.cache.get_or_describe(
      digest,
      [&] {
        return std::make_shared<const SceneCache::Described>(SceneCache::Described{describe(stop)});
      },
      stop);
}

// `held`: bytes beside what is compiled.
SceneCache::ScenePtr RequestRender::build(tracer::SceneDescription description, uint64_t held,
                                          const std::stop_token& stop) {
  for (const auto& [parameter, value] : built_.values) {
    tracer::set_value(parameter, value, description);
  }
  reserve_(held + tracer::estimated_memory(description), 0);
  return std::make_shared<const tracer::Scene>(std::move(description), means_.cache.parts(), stop);
}

// Nothing traces paths faster than this, whatever it traces them through.
void RequestRender::check_time(uint64_t pixels) const {
  constexpr double kPathsPerThreadSecond = 1e8;
  const double most = means_.max_seconds;
  const double paths = static_cast<double>(pixels) * built_.asked.sample_count;
  const double least = paths / (kPathsPerThreadSecond * means_.threads);
  if (most > 0 && built_.asked.pixels == tracer::Pixels::kAll && least > most) {
    throw Error(ErrorKind::kLimit,
                fmt::format("{} samples of {} pixels take more than {:.0f} s; this worker gives a "
                            "request {:g} s (--max-seconds): ask for fewer at a time",
                            built_.asked.sample_count, pixels, least, most));
  }
}

void RequestRender::log(const tracer::FilmSums& sums) const {
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

}  // namespace itn
