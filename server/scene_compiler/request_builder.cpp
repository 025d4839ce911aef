#include "server/scene_compiler/request_builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/scene/derivative_count.h"
#include "common/scene/field_check.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"
#include "server/scene_compiler/field_reader.h"
#include "server/tracer/film/film.h"

namespace itn {
namespace {

void check_loss(const v1::RenderGradRequest& request) {
  if (!request.has_loss()) return;
  if (request.estimates() < 2) {
    throw invalid_input(fmt::format(
        "estimates is {}; a loss needs at least 2, as products of an estimate with itself are "
        "biased",
        request.estimates()));
  }
  if (request.has_tile()) throw invalid_input("loss and tile cannot both be asked for");
  if (!request.albedos().empty()) throw invalid_input("loss and albedos cannot both be asked for");
  if (!request.colours().empty()) throw invalid_input("loss and colours cannot both be asked for");
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

void build_gradient(const v1::RenderGradRequest& request, tracer::RenderRequest& built) {
  if (!request.has_gradient()) return;
  if (request.has_loss()) throw invalid_input("gradient and loss cannot both be asked for");
  built.gradient_weights = array_of<float>("gradient.weight", request.gradient().weight());
  if (request.gradient().has_light()) built.gradient_light = request.gradient().light();
  built.gradient_normals = request.gradient().normals();
  if (built.pilot_spp == 0) return;
  for (const float weight : built.gradient_weights) {
    built.sampling_weights.push_back(std::abs(weight));
  }
}

void build_phase(const v1::RenderGradRequest& request, tracer::RenderRequest& built) {
  if (!request.has_phase()) return;
  built.phase = read_kind<tracer::PhaseFunction>("phase", request.phase(), "kind");
  if (built.material.g != 0) {
    throw invalid_input(
        fmt::format("material.g is {} beside a phase; it must be absent", built.material.g));
  }
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

// Planned samples of a pixel, its place among those of the object, its sampling weight.
constexpr uint64_t kPlanPerPixel = 64;

// How many images there are beside the derivatives: of each estimate, and of all together, which
// are mask and standard errors.
struct ImageCounts {
  uint64_t estimates, of_each, of_all;

  explicit ImageCounts(const v1::RenderGradRequest& request)
      : estimates(std::max(request.estimates(), 1U)),
        of_each(static_cast<uint64_t>(1 + request.albedos_size() + request.colours_size())),
        of_all(static_cast<uint64_t>(2 + request.colours_size())) {}
};

// In bytes.
uint64_t images_per_pixel(const ImageCounts& images, uint64_t derivatives) {
  return sizeof(float) * (images.estimates * (images.of_each + derivatives) + images.of_all);
}

uint64_t sums_per_pixel(const ImageCounts& images, uint64_t derivatives) {
  return images.estimates *
             (sizeof(uint32_t) + sizeof(tracer::Sum) * (images.of_each + derivatives)) +
         images.of_all * sizeof(tracer::Sum);
}

using Values = std::vector<std::pair<tracer::Parameter, double>>;

Values values_of(const v1::RenderGradRequest& request) {
  Values values;
  for (const v1::NamedValue& given : request.values()) {
    const std::string field = fmt::format("values[{}].name is {}", values.size(), given.name());
    const auto parameter = parameter_of(given.name());
    const auto* of_medium = std::get_if<v1::Parameter>(&parameter);
    if (of_medium != nullptr && *of_medium > v1::G) {
      throw invalid_input(field + "; of the medium, sigma_t, albedo and g can be set");
    }
    const tracer::Parameter named = of_medium != nullptr ? tracer::parameter_named(given.name())
                                                         : std::get<tracer::Parameter>(parameter);
    if (std::ranges::find(values, named, &Values::value_type::first) != values.end()) {
      throw invalid_input(field + " again");
    }
    if (named.of_medium() && !request.colours().empty()) {
      throw invalid_input(field + "; the medium is that of the colours");
    }
    values.emplace_back(named, given.value());
  }
  return values;
}

// Sets those of the medium and of its phase function, whose mean cosine is the material's then.
void set_medium(const Values& values, tracer::RenderRequest& built) {
  for (const auto& named : values) {
    const tracer::Parameter& parameter = named.first;
    const double value = named.second;
    switch (parameter.kind) {
      case tracer::Parameter::kSigmaT: built.material.sigma_t = value; break;
      case tracer::Parameter::kAlbedo: built.material.albedo = value; break;
      case tracer::Parameter::kPhase: {
        const Slot& slot = slots_of<tracer::PhaseFunction>()[parameter.slot];
        tracer::PhaseFunction phase = tracer::phase_of(built);
        const bool is_set = use_slot(phase, slot, [&](auto& number, double low, double high) {
          number = static_cast<float>(in_closed(slot.name, value, low, high));
        });
        if (!is_set) throw invalid_input(slot.name + " is no number of the phase function");
        if (built.phase) {
          built.phase = phase;
        } else {
          built.material.g = value;
        }
        break;
      }
      default: break;
    }
  }
  if (!built.phase) return;
  built.material.g = tracer::mean_cosine(built);
  for (Material& colour : built.colours) colour.g = built.material.g;
}

// The derivatives in scales that were set are the parts of the radiance by them.
void divide_by_scales(const Values& values, size_t colours, Derivatives& derivatives) {
  for (size_t p = 0; p < derivatives.parameters.size(); ++p) {
    const tracer::Parameter& parameter = derivatives.parameters[p];
    if (parameter.kind != tracer::Parameter::kLightScale) continue;
    const auto set = std::ranges::find(values, parameter, &Values::value_type::first);
    if (set == values.end()) continue;
    for (std::vector<double>& weights : derivatives.weights) {
      for (size_t c = 0; c < colours; ++c) weights[p * colours + c] /= set->second;
    }
  }
}

// The material that the tracer judges by is the thinnest and palest that there is.
void build_materials(const v1::RenderGradRequest& request, const Values& values,
                     tracer::RenderRequest& built) {
  if (request.colours().empty()) {
    const auto is_set = [&](tracer::Parameter::Kind kind) {
      return std::ranges::any_of(values, [=](const auto& of) { return of.first.kind == kind; });
    };
    if (!request.has_material() &&
        !(is_set(tracer::Parameter::kSigmaT) && is_set(tracer::Parameter::kAlbedo))) {
      throw missing("material");
    }
    built.material = from_proto(request.material());
    return;
  }
  if (request.has_material()) {
    throw invalid_input("material is there beside colours; it must be absent");
  }
  for (const v1::Material& proto : request.colours()) {
    const size_t number = built.colours.size();
    const Material& colour = built.colours.emplace_back(from_proto(proto));
    validate(colour, fmt::format("colours[{}]", number));
    if (number == 0) built.material = colour;
    if (colour.g != built.material.g) {
      throw invalid_input(fmt::format("colours[{}].g is {}; it must be that of colours[0], {}",
                                      number, colour.g, built.material.g));
    }
    built.material.sigma_t = std::min(built.material.sigma_t, colour.sigma_t);
    built.material.albedo = std::max(built.material.albedo, colour.albedo);
  }
}

}  // namespace

// The ranges of what goes to the tracer as it is are checked there.
BuiltRequest build_request(const v1::RenderGradRequest& request, const RenderLimits& limits) {
  check_message(request, "request");
  check_scene_fields(request);
  tracer::RenderRequest built;
  Values values = values_of(request);
  build_materials(request, values, built);
  build_phase(request, built);
  set_medium(values, built);
  validate(built.material);
  built.seed = request.seed();
  built.sample_count = request.spp();
  built.first_sample = request.first_sample();
  if (request.has_tile()) {
    const v1::Tile& tile = request.tile();
    built.tile = tracer::Tile{tile.x(), tile.y(), tile.width(), tile.height()};
  }
  Derivatives derivatives = derivatives_of(
      request, built.colours.empty() ? std::span(&built.material, 1) : std::span(built.colours));
  divide_by_scales(values, std::max<size_t>(built.colours.size(), 1), derivatives);
  built.derivatives = std::move(derivatives.parameters);
  check_loss(request);
  built.albedos.assign(request.albedos().begin(), request.albedos().end());
  built.pilot_spp = request.pilot_spp();
  build_gradient(request, built);
  build_tracer(request, built);
  built.estimates = std::max(request.estimates(), 1U);
  tracer::validate(built);
  within_limit("spp", request.spp(), limits.max_spp);
  std::erase_if(values, [](const auto& of) { return of.first.of_medium(); });
  return {std::move(built), std::move(derivatives.weights), std::move(values)};
}

uint64_t pixel_count(int width, int height, const v1::RenderGradRequest& request) {
  if (request.has_tile()) return uint64_t{request.tile().width()} * request.tile().height();
  return static_cast<uint64_t>(width) * static_cast<uint64_t>(height);
}

void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits, uint64_t gradient_numbers) {
  const ImageCounts images(request);
  const uint64_t pixels = pixel_count(width, height, request);
  if (request.has_loss()) check_target(request.loss(), width, height);
  const uint64_t bytes = images_per_pixel(images, derivative_images(request)) * pixels +
                         sizeof(float) * images.estimates * gradient_numbers;
  if (bytes > limits.max_message_bytes) {
    throw Error(ErrorKind::kLimit,
                fmt::format("the images of the reply would take {} bytes; this worker sends at "
                            "most {}: ask for fewer pixels, estimates or derivatives",
                            bytes, limits.max_message_bytes));
  }
}

uint64_t film_memory(uint64_t pixels, const v1::RenderGradRequest& request,
                     const tracer::RenderRequest& asked, uint64_t gradient_numbers) {
  const ImageCounts images(request);
  const bool is_gradient = request.has_gradient();
  const uint64_t derivatives = is_gradient ? 0 : tracer::derivative_count(asked);
  const uint64_t sums = sums_per_pixel(images, derivatives);
  uint64_t bytes = kPlanPerPixel + sums;
  if (asked.pilot_spp > 0) bytes += sums;
  bytes += images_per_pixel(images, derivatives) +
           3 * sizeof(double);  // of which those of the reply are combined
  if (!request.has_loss()) bytes += 2 * images_per_pixel(images, derivative_images(request));
  // Its weights, and its factors.
  if (is_gradient) bytes += sizeof(float) * (2 + images.estimates);
  const uint64_t bytes_of_number = images.estimates * (sizeof(tracer::Sum) + 3 * sizeof(float));
  return bytes * pixels + bytes_of_number * gradient_numbers;
}

}  // namespace itn
