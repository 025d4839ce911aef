#include "client/refine/scene_unknown.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"
#include "server/renderer.h"

namespace itn {
namespace {

Error none_of(const std::string& name, const std::string& why) {
  return invalid_input(fmt::format("{} cannot be refined: {}", name, why));
}

SceneNumber value_in(const SceneNumbers& scene, const std::string& name) {
  if (name.starts_with("light[") && name.ends_with("].scale")) {
    throw none_of(name,
                  "a scene file has no scale of a light; --exposure unknown finds one of all");
  }
  try {
    return scene.number(name);
  } catch (const Error& error) {
    throw none_of(name, error.what());
  }
}

// That of a coordinate: as far from where it is, on either side, as its vector is long. What is
// known is not many standard deviations away.
LogitScale range_of(const SceneNumber& value, const std::string& name, const SceneNumbers& scene,
                    std::optional<double> deviation) {
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
  const std::vector<SceneNumbers> numbers(scenes.begin(), scenes.end());
  std::vector<SceneUnknown> unknowns;
  for (const std::string& name : names) {
    if (std::ranges::count(names, name) > 1) throw none_of(name, "it is asked for twice");
    const SceneNumber start = value_in(numbers.front(), name);
    for (const SceneNumbers& other : numbers) {
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
                        .range = range_of(start, name, numbers.front(), deviation),
                        .deviation = deviation});
  }
  return unknowns;
}

}  // namespace itn
