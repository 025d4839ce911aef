#include "server/tracer/request/request.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"
#include "common/fields.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {
namespace {

void check_samples(const RenderRequest& request) {
  if (request.sample_count < 1 || request.sample_count > kMaxSamples) {
    throw invalid_input(
        fmt::format("spp is {}; it must be in [1, {}]", request.sample_count, kMaxSamples));
  }
  if (request.first_sample > kMaxSamples - request.sample_count) {
    throw invalid_input(fmt::format("first_sample is {}; with spp, {}, it must be at most {}",
                                    request.first_sample, request.sample_count, kMaxSamples));
  }
}

void check_estimates(const RenderRequest& request) {
  const uint32_t most = std::min(kMaxEstimates, request.sample_count);
  if (request.estimates < 1 || request.estimates > most) {
    throw invalid_input(
        fmt::format("estimates is {}; it must be in [1, {}]", request.estimates, most));
  }
  if (request.first_sample % request.estimates != 0) {
    throw invalid_input(fmt::format("first_sample is {}; it must be a multiple of estimates, {}",
                                    request.first_sample, request.estimates));
  }
}

void check_albedos(const RenderRequest& request) {
  if (request.albedos.size() > kMaxAlbedos) {
    throw invalid_input(fmt::format("the number of albedos is {}; it must be in [0, {}]",
                                    request.albedos.size(), kMaxAlbedos));
  }
  for (size_t i = 0; i < request.albedos.size(); ++i) {
    if (!(request.albedos[i] >= 0 && request.albedos[i] <= request.material.albedo)) {
      throw invalid_input(
          fmt::format("albedos[{}] is {}; it must be in [0, {}], the albedo of the material", i,
                      request.albedos[i], request.material.albedo));
    }
  }
}

void check_colours(const RenderRequest& request) {
  const std::vector<Material>& colours = request.colours;
  if (colours.empty()) return;
  if (colours.size() != kColours.size()) {
    throw invalid_input(fmt::format("the number of colours is {}; it must be 0 or {}",
                                    colours.size(), kColours.size()));
  }
  const Material& material = request.material;
  for (size_t c = 0; c < colours.size(); ++c) {
    itn::validate(colours[c], fmt::format("colours[{}]", c));
    if (colours[c].sigma_t < material.sigma_t || colours[c].albedo > material.albedo ||
        colours[c].g != material.g) {
      throw invalid_input(fmt::format(
          "colours[{}] is sigma_t {}, albedo {}, g {}; that must be at least, at most and exactly "
          "that of the material, {}, {}, {}",
          c, colours[c].sigma_t, colours[c].albedo, colours[c].g, material.sigma_t, material.albedo,
          material.g));
    }
  }
  if (!request.albedos.empty() || !request.gradient_weights.empty() || request.pilot_spp > 0) {
    throw invalid_input("colours have no albedos, no gradient and no pilot");
  }
  for (const Parameter& parameter : request.derivatives) {
    if (shares_paths(parameter)) continue;
    throw invalid_input(
        fmt::format("no derivative in {} of colours that share their paths: there are those in the "
                    "medium and its boundary; others need a render of each colour",
                    name_of(parameter)));
  }
}

void check_derivatives(const RenderRequest& request) {
  const std::vector<Parameter>& derivatives = request.derivatives;
  if (derivative_count(request) > kMaxDerivatives) {
    throw invalid_input(fmt::format("the number of derivatives is {}; it must be in [0, {}]",
                                    derivative_count(request), kMaxDerivatives));
  }
  for (size_t i = 0; i < derivatives.size(); ++i) {
    if (std::find(derivatives.begin(), derivatives.begin() + static_cast<ptrdiff_t>(i),
                  derivatives[i]) != derivatives.begin() + static_cast<ptrdiff_t>(i)) {
      throw invalid_input(
          fmt::format("the derivative in {} is asked for twice", name_of(derivatives[i])));
    }
  }
}

void check_weights(const RenderRequest& request, size_t pixels) {
  const std::vector<float>& weights = request.sampling_weights;
  const bool possible = std::all_of(weights.begin(), weights.end(),
                                    [](float w) { return w >= 0 && std::isfinite(w); });
  if ((!weights.empty() && weights.size() != pixels) || !possible) {
    throw invalid_input(
        fmt::format("there are {} sampling weights; there must be none, or one for each of the {} "
                    "pixels, finite and not negative",
                    weights.size(), pixels));
  }
}

void check_gradient(const RenderRequest& request, size_t pixels) {
  const std::vector<float>& weights = request.gradient_weights;
  const auto possible = [](float w) { return std::abs(double{w}) <= kMaxGradientWeight; };
  const auto zero = [](float w) { return w == 0; };
  if (weights.size() != pixels) {
    throw invalid_input(
        fmt::format("there are {} gradient weights; there must be one for each of the {} pixels",
                    weights.size(), pixels));
  }
  const auto wrong = std::ranges::find_if_not(weights, possible);
  if (wrong != weights.end()) {
    throw invalid_input(
        fmt::format("the gradient weight of pixel {} is {}; it must be at most {:g} "
                    "in size",
                    wrong - weights.begin(), *wrong, kMaxGradientWeight));
  }
  if (std::ranges::all_of(weights, zero)) throw invalid_input("all gradient weights are 0");
}

void check_gradient_light(const RenderRequest& request, const Scene& scene) {
  const uint32_t number = *request.gradient_light;
  if (request.gradient_weights.empty()) {
    throw invalid_input("a gradient in a light's pixels needs gradient weights");
  }
  if (request.tracer == Tracer::kReference) {
    throw invalid_input("the reference tracer knows no gradient in a light's pixels");
  }
  if (scene.compiled().lights.map_of(number) == nullptr) {
    throw invalid_input(fmt::format("lights[{}] is no panorama that shines", number));
  }
}

// The derivatives of paths that follow edges: they meet lights by chance alone.
void check_edges_find_lights(const Lights& lights, const char* what) {
  for (const Lights::Light& light : lights.all()) {
    if (lights.described(light.number).has_size) continue;
    throw invalid_input(fmt::format(
        "no derivative in {} under lights[{}], which has no size: part of it is on paths that do "
        "not find such a light; a directional one may have an angular_radius_degrees, and for a "
        "point or a spot there are sphere and panel",
        what, light.number));
  }
}

void check_gradient_normals(const RenderRequest& request, const Scene::Compiled& scene) {
  if (request.gradient_weights.empty()) {
    throw invalid_input("a gradient in normals needs gradient weights");
  }
  if (request.tracer == Tracer::kReference) {
    throw invalid_input("the reference tracer knows no gradient in normals");
  }
  if (!index_slot(scene.boundary)) {
    throw invalid_input(
        fmt::format("no gradient in normals: the object has no {}; where a boundary is smooth, its "
                    "normals turn the paths, and no score tells what comes of that",
                    RoughDielectric::kName));
  }
  if (differentiated_index(request, scene.boundary)) {
    throw invalid_input(
        "a gradient in normals and one in the index of refraction need a render of each");
  }
  check_edges_find_lights(scene.lights, "normals");
}

void check_tile(const Tile& tile, const Scene& scene) {
  const auto inside = [](uint64_t first, uint64_t count, int length) {
    return count > 0 && first + count <= static_cast<uint64_t>(length);
  };
  if (!inside(tile.x, tile.width, scene.width()) || !inside(tile.y, tile.height, scene.height())) {
    throw invalid_input(fmt::format(
        "tile is {} x {} pixels at ({}, {}); it must hold a pixel and lie in the film, {} x {}",
        tile.width, tile.height, tile.x, tile.y, scene.width(), scene.height()));
  }
}

Error no_derivative(const Parameter& parameter, const std::string& why) {
  return invalid_input(fmt::format("no derivative in {}: {}", name_of(parameter), why));
}

void check_index(const Parameter& parameter, size_t count, const char* what) {
  if (parameter.index >= count) {
    const std::string have = count == 0 ? fmt::format("the scene has no {}", what)
                             : count == 1
                                 ? fmt::format("the scene has one {}, number 0", what)
                                 : fmt::format("the scene has {}s 0 to {}", what, count - 1);
    throw no_derivative(parameter, have);
  }
}

// Whether what the parameter is of has its slot.
template <typename Kinds>
void check_slot(const Parameter& parameter, size_t kind) {
  const std::vector<Slot>& slots = slots_of<Kinds>();
  if (slots[parameter.slot].kind == kind) return;
  std::string have;
  for (uint32_t slot = 0; slot < slots.size(); ++slot) {
    if (slots[slot].kind != kind) continue;
    have += (have.empty() ? "" : ", ") + name_of({parameter.kind, parameter.index, slot});
  }
  throw no_derivative(
      parameter, have.empty() ? "there is none in what the scene has instead" : "there is " + have);
}

// Shadow rays to its outline are all that find how a light moves.
void check_place(const Parameter& parameter, const Scene::Compiled& scene, Tracer tracer) {
  const Lights::Described& light = scene.lights.described(parameter.index);
  check_slot<LightDescription>(parameter, light.kind);
  if (!light.has_size) {
    throw no_derivative(parameter, "the light has no size; it may have an angular_radius_degrees");
  }
  if (stops_lines(scene.boundary) && is_delta(scene.boundary)) {
    throw no_derivative(parameter,
                        "the object's boundary is smooth; behind a rough one, or one that is "
                        "index-matched, there is one");
  }
  if (tracer == Tracer::kReference) {
    throw no_derivative(parameter, "the reference tracer knows none");
  }
}

}  // namespace

PhaseFunction phase_of(const RenderRequest& request) {
  return request.phase.value_or(HenyeyGreenstein{static_cast<float>(request.material.g)});
}

bool shares_paths(const Parameter& parameter) {
  return parameter.of_medium() || parameter.kind == Parameter::kBoundary;
}

size_t derivative_count(const RenderRequest& request) {
  return request.derivatives.size() * std::max<size_t>(request.colours.size(), 1);
}

std::optional<size_t> differentiated_index(const RenderRequest& request, const Boundary& boundary) {
  for (const Parameter& parameter : request.derivatives) {
    if (parameter.kind != Parameter::kBoundary) continue;
    const size_t slot = slots_of<Boundary>()[parameter.slot].number;
    if (index_slot(boundary) == slot) return slot;
  }
  return std::nullopt;
}

double mean_cosine(const RenderRequest& request) {
  if (!request.phase) return request.material.g;
  return mean_cosine(*request.phase);
}

size_t gradient_numbers(const RenderRequest& request, const Scene& scene) {
  const Scene::Compiled& compiled = scene.compiled();
  size_t numbers = request.gradient_normals ? 9 * compiled.object_triangles() : 0;
  if (request.gradient_light) {
    numbers += compiled.lights.map_of(*request.gradient_light)->table().pixels();
  }
  return numbers;
}

void validate(const RenderRequest& request) {
  itn::validate(request.material);
  check_samples(request);
  check_estimates(request);
  check_albedos(request);
  check_colours(request);
  check_derivatives(request);
  const PhaseFunction phase = phase_of(request);
  check_fields("phase.", phase);
  for (const Parameter& parameter : request.derivatives) {
    if (parameter.kind == Parameter::kPhase) check_slot<PhaseFunction>(parameter, phase.index());
  }
  if (request.pilot_spp > kMaxPilotSpp) {
    throw invalid_input(
        fmt::format("pilot_spp is {}; it must be in [0, {}]", request.pilot_spp, kMaxPilotSpp));
  }
  if (request.tracer == Tracer::kReference &&
      (!request.albedos.empty() || !request.colours.empty() || request.pilot_spp > 0)) {
    throw invalid_input("the reference tracer knows neither albedos, colours nor pilot_spp");
  }
}

void validate(const RenderRequest& request, const Scene& scene) {
  validate(request);
  if (request.tile) check_tile(*request.tile, scene);
  const auto pixels = static_cast<size_t>(scene.width()) * static_cast<size_t>(scene.height());
  check_weights(request, pixels);
  if (!request.gradient_weights.empty()) check_gradient(request, pixels);
  if (request.gradient_light) check_gradient_light(request, scene);
  const Scene::Compiled& compiled = scene.compiled();
  if (request.colours.empty() != (compiled.film.channel != Channel::kRgb)) {
    throw invalid_input("colours and a film whose channel is RGB need one another");
  }
  if (!request.colours.empty() && !compiled.other_media.empty()) {
    throw invalid_input(
        "colours do not share their paths where there are other_objects: they need a render of "
        "each colour");
  }
  if (request.gradient_normals) check_gradient_normals(request, compiled);
  if (differentiated_index(request, compiled.boundary)) {
    check_edges_find_lights(compiled.lights, "the index of refraction");
  }
  for (const Parameter& parameter : request.derivatives) {
    if (parameter.kind == Parameter::kBoundary) {
      check_slot<Boundary>(parameter, compiled.boundary.index());
    } else if (parameter.kind == Parameter::kReflectance) {
      check_index(parameter, scene.surface_count(), "surface");
      check_slot<Reflectance>(parameter, compiled.surfaces[parameter.index].reflectance.index());
    } else if (parameter.kind == Parameter::kLightScale) {
      check_index(parameter, scene.light_count(), "light");
    } else if (parameter.kind == Parameter::kLightPlace) {
      check_index(parameter, scene.light_count(), "light");
      check_place(parameter, compiled, request.tracer);
    }
  }
}

}  // namespace itn::tracer
