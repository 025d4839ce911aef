#include "server/render/request_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/error.h"
#include "common/rpc/wire_array.h"
#include "server/render/derivatives.h"
#include "server/render/field_check.h"

namespace itn {
namespace {

void build_sample_range(const v1::RenderGradRequest& request, tracer::RenderRequest& built) {
  built.first_sample = 0;
  built.sample_count = request.spp();
  if (!request.has_sample_range()) return;
  const v1::SampleRange& range = request.sample_range();
  if (range.count() < 1 || uint64_t{range.first()} + range.count() > request.spp()) {
    throw invalid_input(fmt::format(
        "sample_range is [{}, {}); it must hold at least one sample and end at most at spp = {}",
        range.first(), uint64_t{range.first()} + range.count(), request.spp()));
  }
  built.first_sample = range.first();
  built.sample_count = range.count();
}

void check_loss(const v1::RenderGradRequest& request) {
  if (!request.has_loss()) return;
  if (request.estimates() < 2) {
    throw invalid_input(fmt::format(
        "estimates is {}; a loss needs at least 2, as products of an estimate with itself are "
        "biased",
        request.estimates()));
  }
  if (request.exact_sums()) {
    throw invalid_input("loss and exact_sums cannot both be asked for");
  }
  if (!request.albedos().empty()) {
    throw invalid_input("loss and albedos cannot both be asked for");
  }
  // A part has no samples of the pixels to which the pilot gives few.
  if (request.pilot_spp() > 0 && request.has_sample_range() &&
      request.sample_range().count() < request.spp()) {
    throw invalid_input(
        "a loss with pilot_spp is of all samples: leave out sample_range or pilot_spp");
  }
}

// Values of an image of the target; `positive`: none may be negative.
std::vector<float> target_values(const char* name, const std::string& bytes, int width, int height,
                                 bool positive) {
  const size_t expected = static_cast<size_t>(width) * static_cast<size_t>(height) * sizeof(float);
  if (bytes.size() != expected) {
    throw invalid_input(fmt::format("{} has {} bytes; {} x {} float32 have {}", name, bytes.size(),
                                    width, height, expected));
  }
  std::vector<float> values = from_bytes<float>(bytes);
  for (size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i]) || (positive && values[i] < 0)) {
      throw invalid_input(fmt::format("{}: value {} is {}; it must be finite{}", name, i, values[i],
                                      positive ? " and not negative" : ""));
    }
  }
  return values;
}

void check_target(const v1::LossTarget& loss, int width, int height) {
  const auto image = target_values("loss.image", loss.image(), width, height, false);
  const auto weight = target_values("loss.weight", loss.weight(), width, height, true);
  for (size_t i = 0; i < image.size(); ++i) {
    if (image[i] * weight[i] != 0) return;
  }
  throw invalid_input("loss: the image is black where its weight is not 0");
}

void build_tracer(const v1::RenderGradRequest& request, tracer::RenderRequest& built) {
  if (!v1::RenderedPixels_IsValid(request.pixels())) {
    throw invalid_input(
        fmt::format("pixels has the unknown value {}", static_cast<int>(request.pixels())));
  }
  if (!v1::Tracer_IsValid(request.tracer())) {
    throw invalid_input(
        fmt::format("tracer has the unknown value {}", static_cast<int>(request.tracer())));
  }
  built.pixels =
      request.pixels() == v1::OBJECT_PIXELS ? tracer::Pixels::kObject : tracer::Pixels::kAll;
  built.tracer =
      request.tracer() == v1::REFERENCE ? tracer::Tracer::kReference : tracer::Tracer::kWavefront;
}

void check_scene_fields(const v1::RenderGradRequest& request) {
  if (request.scene().empty() && request.scene_digest().empty()) {
    throw missing("scene or scene_digest");
  }
  if (const size_t size = request.scene_digest().size(); size != 0 && size != 32) {
    throw invalid_input(fmt::format("scene_digest has {} bytes; a SHA-256 has 32", size));
  }
}

}  // namespace

Material build_material(const v1::Material& proto) {
  const Material material{proto.sigma_t(), proto.albedo(), proto.g()};
  validate(material);
  return material;
}

// The ranges of what goes to the tracer as it is are checked there.
tracer::RenderRequest build_request(const v1::RenderGradRequest& request,
                                    const RenderLimits& limits) {
  check_message(request, "request");
  check_scene_fields(request);
  if (!request.has_material()) throw missing("material");
  integer_in("spp", request.spp(), 1, 1U << 20);
  within_limit("spp", request.spp(), limits.max_spp);
  tracer::RenderRequest built;
  built.material = build_material(request.material());
  built.seed = request.seed();
  built.spp = request.spp();
  build_sample_range(request, built);
  built.derivatives = derivatives_of(request, built.material).parameters;
  check_loss(request);
  built.albedos.assign(request.albedos().begin(), request.albedos().end());
  built.pilot_spp = request.pilot_spp();
  build_tracer(request, built);
  built.estimates = std::max(request.estimates(), 1U);
  tracer::validate(built);
  return built;
}

void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits) {
  const uint64_t estimates = std::max(request.estimates(), 1U);
  const uint64_t derivatives = request.derivatives_size();
  const uint64_t albedos = request.albedos_size();
  const uint64_t pixels = static_cast<uint64_t>(width) * height;
  if (request.has_loss()) check_target(request.loss(), width, height);
  // Estimates, mask and standard error; or sums and counts, squares and hits.
  const uint64_t sums =
      1 + derivatives_of(request, build_material(request.material())).parameters.size();
  const uint64_t bytes_per_pixel =
      request.exact_sums()
          ? sizeof(int64_t) * (estimates * (sums + albedos) + 2) + sizeof(uint32_t) * estimates
          : sizeof(float) * (estimates * (1 + derivatives + albedos) + 2);
  const uint64_t bytes = bytes_per_pixel * pixels;
  if (bytes > limits.max_message_bytes) {
    throw Error(ErrorKind::kLimit,
                fmt::format("the images of the reply would take {} bytes; this worker sends at "
                            "most {}: ask for fewer pixels, estimates or derivatives",
                            bytes, limits.max_message_bytes));
  }
}

}  // namespace itn
