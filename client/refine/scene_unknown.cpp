#include "client/refine/scene_unknown.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/scene/value.h"

namespace itn {
namespace {

Error none_of(const std::string& name, const std::string& why) {
  return invalid_input(fmt::format("{} cannot be refined: {}", name, why));
}

tracer::ParameterValue value_in(const tracer::SceneDescription& scene, const std::string& name) {
  const tracer::Parameter parameter = tracer::parameter_named(name);
  if (parameter.kind == tracer::Parameter::kLightScale) {
    throw none_of(name,
                  "a scene file has no scale of a light; --exposure unknown finds one of all");
  }
  try {
    return value_of(scene, parameter);
  } catch (const Error& error) {
    throw none_of(name, error.what());
  }
}

// That of a coordinate: as far from where it is, on either side, as its vector is long. What is
// known is not many standard deviations away.
LogitScale range_of(const tracer::ParameterValue& value, const std::string& name,
                    const tracer::SceneDescription& scene, std::optional<double> deviation) {
  constexpr double kMany = 8;
  if (deviation) {
    const auto inside = [&](double place) { return std::clamp(place, value.low, value.high); };
    return {inside(value.value - kMany * *deviation), inside(value.value + kMany * *deviation)};
  }
  if (std::isfinite(value.low)) return {value.low, value.high};
  double reach = 0;
  std::string coordinate = name;
  for (const char axis : {'x', 'y', 'z'}) {
    coordinate.back() = axis;
    reach = std::hypot(reach, value_in(scene, coordinate).value);
  }
  return {value.value - reach, value.value + reach};
}

}  // namespace

std::vector<SceneUnknown> scene_unknowns(std::span<const std::string> names,
                                         std::span<const v1::Scene> scenes,
                                         const std::map<std::string, double>& deviations) {
  std::vector<tracer::SceneDescription> descriptions;
  for (const v1::Scene& scene : scenes) descriptions.push_back(build_scene(scene, {}));
  std::vector<SceneUnknown> unknowns;
  for (const std::string& name : names) {
    if (std::ranges::count(names, name) > 1) throw none_of(name, "it is asked for twice");
    const tracer::ParameterValue start = value_in(descriptions.front(), name);
    for (const tracer::SceneDescription& other : descriptions) {
      const double value = value_in(other, name).value;
      if (value == start.value) continue;
      throw none_of(name, fmt::format("it is {:g} in the first scene and {:g} in another; it must "
                                      "be the same in all",
                                      start.value, value));
    }
    const auto known = deviations.find(name);
    const std::optional<double> deviation =
        known == deviations.end() ? std::nullopt : std::optional(known->second);
    unknowns.push_back({.name = name,
                        .start = start.value,
                        .range = range_of(start, name, descriptions.front(), deviation),
                        .deviation = deviation});
  }
  return unknowns;
}

}  // namespace itn
