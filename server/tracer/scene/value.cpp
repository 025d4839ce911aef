#include "server/tracer/scene/value.h"

#include <fmt/format.h>

#include <string>
#include <variant>

#include "common/error.h"
#include "common/fields.h"

namespace itn::tracer {
namespace {

// A light's scale is a factor on that of the scene, which is 1.
constexpr double kLeastScale = 1e-6, kMostScale = 1e6;

Error absent(const Parameter& parameter, const std::string& why) {
  return invalid_input(fmt::format("{} is not in the scene: {}", name_of(parameter), why));
}

template <typename List>
auto& entry_of(List& list, const Parameter& parameter, const char* what) {
  if (parameter.index < list.size()) return list[parameter.index];
  throw absent(parameter, fmt::format("it has {} {}", list.size(), what));
}

// Calls use(number, low, high) with the number that a parameter other than a light's scale is.
template <typename Description, typename Use>
void use_number(Description& scene, const Parameter& parameter, const Use& use) {
  const auto use_in = [&](auto& kinds, const std::string& place, const char* of_no_name) {
    using Kinds = std::remove_cvref_t<decltype(kinds)>;
    if (use_slot(kinds, slots_of<Kinds>()[parameter.slot], use)) return;
    const std::string kind =
        std::visit([](const auto& it) { return std::string(it.kName); }, kinds);
    throw absent(parameter, fmt::format("{} is {}", place, kind.empty() ? of_no_name : kind));
  };
  switch (parameter.kind) {
    case Parameter::kBoundary: return use_in(scene.boundary, "the boundary", "index-matched");
    case Parameter::kReflectance:
      return use_in(entry_of(scene.surfaces, parameter, "surfaces").reflectance,
                    fmt::format("surfaces[{}]", parameter.index), "of one reflectance");
    case Parameter::kLightPlace:
      return use_in(entry_of(scene.lights, parameter, "lights"),
                    fmt::format("lights[{}]", parameter.index), "another");
    case Parameter::kScattered: throw absent(parameter, "it is a part of the radiance");
    default: throw absent(parameter, "it is of the medium");
  }
}

}  // namespace

ParameterValue value_of(const SceneDescription& scene, const Parameter& parameter) {
  if (parameter.kind == Parameter::kLightScale) {
    entry_of(scene.lights, parameter, "lights");
    return {1, kLeastScale, kMostScale};
  }
  ParameterValue result{};
  use_number(scene, parameter, [&](const auto& number, double low, double high) {
    result = {static_cast<double>(number), low, high};
  });
  return result;
}

void set_value(const Parameter& parameter, double value, SceneDescription& scene) {
  const std::string name = name_of(parameter);
  if (parameter.kind == Parameter::kLightScale) {
    brighten(entry_of(scene.lights, parameter, "lights"),
             in_closed(name, value, kLeastScale, kMostScale));
    return;
  }
  use_number(scene, parameter, [&](auto& number, double low, double high) {
    number = static_cast<float>(in_closed(name, value, low, high));
  });
}

}  // namespace itn::tracer
