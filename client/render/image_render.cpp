#include "client/render/image_render.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "client/object_media.h"
#include "client/render/reply_images.h"
#include "client/render/shared_colours.h"
#include "client/render/tiles.h"
#include "common/error.h"
#include "common/geometry/mesh.h"
#include "common/render_limits.h"
#include "common/scene/mesh_builder.h"
#include "common/scene/wire_array.h"
#include "server/renderer.h"

namespace itn {
namespace {

Material chosen_material(const ImageRequest& request, const v1::Scene& scene,
                         v1::Film::Channel shown) {
  if (request.medium.empty()) {
    const auto number = [&](const std::vector<double>& numbers) {
      return numbers.empty() ? 0 : numbers[std::min(number_of_channel(shown), numbers.size() - 1)];
    };
    return {number(request.sigma_t), number(request.albedo), number(request.g)};
  }
  return material_of(request.medium, request.object_size, "scene.object", scene.object(), shown);
}

// Asks for what the film shows, without the material.
RenderQuery query_of(const ImageRequest& request, v1::Scene scene, v1::Film::Channel shown) {
  scene.mutable_film()->set_channel(shown);
  resolve_media(scene);
  return {.scene = serialize(scene),
          .material = {},
          .phase = request.phase,
          .values = request.values,
          .spp = request.spp,
          .seed = request.seed,
          .estimates = request.estimates,
          .pilot_spp = request.pilot_spp,
          .derivatives = request.derivatives,
          .pixels = request.pixels,
          .tracer = request.tracer};
}

// Whether one render of all channels does what three do, and costs less.
bool share_paths(const ImageRequest& request, const v1::Scene& scene,
                 std::span<const ImageChannel> channels) {
  if (channels.size() == 1 || request.tracer == v1::REFERENCE || request.pilot_spp > 0 ||
      !scene.other_objects().empty()) {
    return false;
  }
  for (const std::string& name : request.derivatives) {
    if (!shares_paths(name)) return false;
  }
  if (request.derivatives.size() * channels.size() > kMaxDerivatives) return false;
  std::vector<Material> materials;
  for (const ImageChannel& channel : channels) materials.push_back(channel.material);
  const auto other_g = [&](const Material& m) { return m.g != materials[0].g; };
  return std::ranges::none_of(materials, other_g) &&
         shared_paths_pay(materials, longest_side(object_bounds("scene.object", scene.object())));
}

// Of the noisiest channel. NaN where nothing tells: of one sample, or without light.
double noise_of(std::span<const v1::RenderGradReply> replies, const std::vector<float>& mask,
                uint32_t spp) {
  double noise = 0;
  for (const v1::RenderGradReply& reply : replies) {
    const std::vector<float> radiance = mean_radiance(reply, spp);
    if (spp == 1 || std::ranges::none_of(radiance, [](float v) { return v > 0; })) return NAN;
    const std::vector<float> error = from_bytes<float>(reply.standard_error());
    noise = std::max(noise, noise_on_object(radiance, error, mask));
  }
  return noise;
}

}  // namespace

bool take_medium(const v1::Scene& scene, ImageRequest& request) {
  const v1::Object& object = scene.object();
  if (object.has_medium()) {
    material_of("scene.object", object, v1::Film::GREEN);  // is checked
    request.medium = object.medium().name();
    request.object_size = double{object.medium().object_size()};
    return true;
  }
  if (object.material().empty()) return false;
  for (const v1::Film::Channel shown : {v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE}) {
    const Material material = *material_of("scene.object", object, shown);
    request.sigma_t.push_back(material.sigma_t);
    request.albedo.push_back(material.albedo);
    request.g.push_back(material.g);
  }
  return true;
}

std::vector<ImageChannel> channels_of(const ImageRequest& request, const v1::Scene& scene) {
  const auto channel = [&](const char* name, v1::Film::Channel shown) {
    return ImageChannel{name, shown, chosen_material(request, scene, shown)};
  };
  if (!request.colour) return {channel("Y", scene.film().channel())};
  return {channel("R", v1::Film::RED), channel("G", v1::Film::GREEN), channel("B", v1::Film::BLUE)};
}

std::vector<RenderJob> jobs_of(const ImageRequest& request, const v1::Scene& scene,
                               std::span<const ImageChannel> channels) {
  if (share_paths(request, scene, channels)) {
    RenderQuery query = query_of(request, scene, v1::Film::RGB);
    for (const ImageChannel& channel : channels) query.colours.push_back(channel.material);
    return {job_of(query)};
  }
  std::vector<RenderJob> jobs;
  for (const ImageChannel& channel : channels) {
    RenderQuery query = query_of(request, scene, channel.shown);
    query.material = channel.material;
    jobs.push_back(job_of(query));
  }
  return jobs;
}

std::vector<v1::RenderGradReply> replies_of(std::span<const ImageChannel> channels,
                                            std::vector<v1::RenderGradReply> replies) {
  if (replies.size() == channels.size()) return replies;
  std::vector<v1::RenderGradReply> in_colour;
  for (size_t c = 0; c < channels.size(); ++c) {
    in_colour.push_back(reply_in_colour(replies[0], static_cast<int>(c)));
  }
  return in_colour;
}

v1::RenderedPixels pixels_named(const std::string& word) {
  require(word == "all" || word == "object", "pixels: it is 'all' or 'object'");
  return word == "object" ? v1::OBJECT_PIXELS : v1::ALL_PIXELS;
}

v1::Tracer tracer_named(const std::string& word) {
  require(word == "wavefront" || word == "reference", "tracer: it is 'wavefront' or 'reference'");
  return word == "reference" ? v1::REFERENCE : v1::WAVEFRONT;
}

v1::Counters sum_of_counters(std::span<const v1::RenderGradReply> replies) {
  v1::Counters sum;
  for (const v1::RenderGradReply& reply : replies) add_counters(reply.counters(), sum);
  return sum;
}

double coverage(std::span<const float> mask) {
  return std::accumulate(mask.begin(), mask.end(), 0.0) / static_cast<double>(mask.size());
}

std::vector<std::string> remarks_on(std::span<const ImageChannel> channels,
                                    std::span<const v1::RenderGradReply> replies,
                                    const v1::Counters& counters, const RenderGoal& goal,
                                    uint32_t spp) {
  std::vector<std::string> remarks;
  const std::vector<float> mask = from_bytes<float>(replies[0].mask());
  if (const double noise = noise_of(replies, mask, spp); goal.noise > 0 && !(noise <= goal.noise)) {
    remarks.push_back(fmt::format(
        "the noise is {}, not {:.2g} %: the {} over before",
        std::isnan(noise) ? "unknown" : fmt::format("{:.2g} %", 100 * noise), 100 * goal.noise,
        goal.seconds > 0 ? "time or the samples were" : "samples were"));
  }
  const double covered = coverage(mask);
  const double pixels = static_cast<double>(replies[0].width()) * replies[0].height();
  constexpr double kTiny = 1e-3;
  if (covered < kTiny || covered * pixels < 1) {
    remarks.push_back(
        (covered == 0 ? std::string("the camera does not see the object: it is in no pixel")
                      : fmt::format("the camera hardly sees the object: it covers {:.2g} of {} "
                                    "pixels",
                                    covered * pixels, pixels)) +
        ". Is it at the camera's target, and of the size that is meant, in mm?");
  }
  for (size_t c = 0; c < channels.size(); ++c) {
    const bool is_black = std::ranges::all_of(replies[c].estimates(), [](const v1::Estimate& e) {
      return std::ranges::all_of(from_bytes<float>(e.radiance()), [](float v) { return v == 0; });
    });
    if (!is_black) continue;
    remarks.push_back(fmt::format(
        "{} is black: no sample found light. Do the lights reach what the camera sees? Small "
        "lights behind what is nearly black take more samples",
        channels[c].name));
  }
  // Paths that were dropped count as black: where they are many, the image is too dark.
  constexpr double kMany = 1e-4, kTooMany = 0.01;
  const double paths = std::max(1.0, static_cast<double>(counters.paths()) * covered);
  const auto say = [&](uint64_t count, const std::string& why) {
    const double part = static_cast<double>(count) / paths;
    if (part <= kMany) return;
    const std::string what = fmt::format(
        "{:.2g} % of the paths that meet the object were dropped, {}: the object is darker by "
        "about as much",
        100 * std::min(1.0, part), why);
    if (part > kTooMany) throw invalid_input(what + "; such an image is not written");
    remarks.push_back(what);
  };
  say(counters.leaks(),
      "as they were on the wrong side of the boundary: a mesh that cuts through itself does that, "
      "and one that is thin for its size, or far from its origin");
  say(counters.invalid_samples(), "as their light was no number");
  return remarks;
}

}  // namespace itn
