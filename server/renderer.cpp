#include "server/renderer.h"

#include <fmt/format.h>

#include <variant>

#include "common/error.h"
#include "server/scene_compiler/derivatives.h"
#include "server/scene_compiler/object_builder.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/lights/sun_sky_irradiance.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/value.h"

namespace itn {
namespace {

// Nothing if it is of the medium.
std::optional<tracer::Parameter> parameter_of_scene(const std::string& name) {
  const auto parameter = parameter_of(name);
  const auto* of_scene = std::get_if<tracer::Parameter>(&parameter);
  if (of_scene == nullptr || of_scene->of_medium()) return std::nullopt;
  return *of_scene;
}

}  // namespace

void check_scene(const v1::Scene& scene) {
  const tracer::Scene compiled(build_scene(scene, {}));
}

std::vector<std::string> derivative_names() {
  return parameter_names();
}

bool is_of_medium(const std::string& parameter) {
  return !parameter_of_scene(parameter);
}

bool shares_paths(const std::string& parameter) {
  const auto found = parameter_of(parameter);
  const auto* accumulated = std::get_if<tracer::Parameter>(&found);
  return accumulated == nullptr || tracer::shares_paths(*accumulated);
}

SceneNumbers::SceneNumbers(const v1::Scene& scene)
    : scene_(std::make_shared<const tracer::SceneDescription>(build_scene(scene, {}))) {}

SceneNumber SceneNumbers::number(const std::string& parameter) const {
  const auto found = parameter_of_scene(parameter);
  if (!found) {
    throw invalid_input(fmt::format("{} is not in the scene: it is of the medium", parameter));
  }
  const auto [value, low, high] = value_of(*scene_, *found);
  return {value, low, high};
}

std::optional<SurfaceOfMedium> surface_of_medium(const std::string& field,
                                                 const v1::Object& object) {
  const tracer::Boundary boundary = build_boundary(field, object);
  if (std::holds_alternative<tracer::IndexMatched>(boundary)) return std::nullopt;
  SurfaceOfMedium surface;
  surface.index = tracer::relative_index(boundary);
  if (const auto* rough = std::get_if<tracer::RoughDielectric>(&boundary)) {
    surface.roughness = rough->roughness;
  }
  return surface;
}

double irradiance_from_above(const v1::SunSky& light, v1::Film::Channel channel) {
  v1::Light wrapped;
  *wrapped.mutable_sun_sky() = light;
  return tracer::irradiance_from_above(std::get<tracer::SunSkyLight>(build_light("light", wrapped)),
                                       build_channel(channel));
}

}  // namespace itn
