#include "server/render/request_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "common/error.h"
#include "common/rpc/wire_array.h"
#include "server/render/field_check.h"

namespace itn {
namespace {

void build_sample_range(const v1::RenderGradRequest& request, tracer::RenderSettings& settings) {
  settings.first_sample = 0;
  settings.sample_count = request.spp();
  if (!request.has_sample_range()) return;
  const v1::SampleRange& range = request.sample_range();
  if (range.count() < 1 || uint64_t{range.first()} + range.count() > request.spp()) {
    throw invalid_input(fmt::format(
        "sample_range is [{}, {}); it must hold at least one sample and end at most at spp = {}",
        range.first(), uint64_t{range.first()} + range.count(), request.spp()));
  }
  settings.first_sample = range.first();
  settings.sample_count = range.count();
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

void build_albedos(const v1::RenderGradRequest& request, tracer::RenderSettings& settings) {
  integer_in("the number of albedos", request.albedos_size(), 0, int{tracer::kMaxAlbedos});
  for (int i = 0; i < request.albedos_size(); ++i) {
    if (!(request.albedos(i) >= 0 && request.albedos(i) <= settings.material.albedo)) {
      throw invalid_input(
          fmt::format("albedos[{}] is {}; it must be in [0, {}], the albedo of the material", i,
                      request.albedos(i), settings.material.albedo));
    }
    settings.albedos.push_back(request.albedos(i));
  }
}

void build_tracer(const v1::RenderGradRequest& request, tracer::RenderSettings& settings) {
  if (!v1::RenderedPixels_IsValid(request.pixels())) {
    throw invalid_input(
        fmt::format("pixels has the unknown value {}", static_cast<int>(request.pixels())));
  }
  if (!v1::Tracer_IsValid(request.tracer())) {
    throw invalid_input(
        fmt::format("tracer has the unknown value {}", static_cast<int>(request.tracer())));
  }
  settings.pixels =
      request.pixels() == v1::OBJECT_PIXELS ? tracer::Pixels::kObject : tracer::Pixels::kAll;
  settings.pilot_spp = integer_in("pilot_spp", request.pilot_spp(), 0, 64);
  if (request.tracer() == v1::REFERENCE) {
    settings.tracer = tracer::Tracer::kReference;
    if (!request.albedos().empty() || request.pilot_spp() > 0) {
      throw invalid_input("the REFERENCE tracer knows neither albedos nor pilot_spp");
    }
  }
}

void check_derivatives(const v1::RenderGradRequest& request) {
  std::set<int> seen;
  for (int i = 0; i < request.derivatives_size(); ++i) {
    const v1::Parameter parameter = request.derivatives(i);
    if (parameter == v1::PARAMETER_UNSPECIFIED || !v1::Parameter_IsValid(parameter)) {
      throw invalid_input(fmt::format("derivatives[{}] is {}; it must be in [{}, {}]", i,
                                      static_cast<int>(parameter), v1::Parameter_MIN + 1,
                                      static_cast<int>(v1::Parameter_MAX)));
    }
    if (!seen.insert(parameter).second) {
      throw invalid_input(
          fmt::format("derivatives[{}] is {} again", i, v1::Parameter_Name(parameter)));
    }
  }
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

tracer::RenderSettings build_settings(const v1::RenderGradRequest& request,
                                      const RenderLimits& limits) {
  check_message(request, "request");
  check_scene_fields(request);
  if (!request.has_material()) throw missing("material");
  integer_in("spp", request.spp(), 1, 1U << 20);
  within_limit("spp", request.spp(), limits.max_spp);
  tracer::RenderSettings settings;
  settings.material = build_material(request.material());
  settings.seed = request.seed();
  build_sample_range(request, settings);
  check_derivatives(request);
  settings.derivatives = !request.derivatives().empty() || request.has_loss();
  check_loss(request);
  build_albedos(request, settings);
  build_tracer(request, settings);
  settings.spp = request.spp();
  const uint32_t most = std::min(kMaxEstimates, settings.sample_count);
  settings.estimates =
      request.estimates() == 0 ? 1 : integer_in("estimates", request.estimates(), 1, most);
  return settings;
}

void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits) {
  const uint64_t estimates = std::max(request.estimates(), 1U);
  const uint64_t derivatives = request.derivatives_size();
  const uint64_t albedos = request.albedos_size();
  const uint64_t pixels = static_cast<uint64_t>(width) * height;
  if (request.has_loss()) check_target(request.loss(), width, height);
  // Estimates, mask and standard error; or sums and counts, squares and hits.
  const uint64_t sums = derivatives > 0 ? 1 + tracer::kCoordinates : 1;
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
