#include "server/tracer/parameters/parameter.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <optional>

#include "common/error.h"
#include "common/fields.h"
#include "server/tracer/boundary/boundary.h"
#include "server/tracer/lights/kinds.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/surfaces/reflectance.h"

namespace itn::tracer {
namespace {

// Reads "PREFIX[INDEX].SUFFIX" with an INDEX as it is printed: no sign, no leading zero.
bool read_indexed(std::string_view name, std::string_view prefix, std::string suffix,
                  uint32_t& index) {
  suffix = "]." + suffix;
  if (!name.starts_with(prefix) || !name.ends_with(suffix) ||
      name.size() <= prefix.size() + suffix.size()) {
    return false;
  }
  name.remove_prefix(prefix.size());
  name.remove_suffix(suffix.size());
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), index);
  return error == std::errc{} && end == name.data() + name.size() &&
         (name.size() == 1 || name.front() != '0');
}

// The number of the slot of a list of kinds whose name is right.
template <typename Kinds, typename IsRight>
std::optional<uint32_t> find_slot(const IsRight& is_right) {
  const std::vector<Slot>& slots = slots_of<Kinds>();
  for (uint32_t slot = 0; slot < slots.size(); ++slot) {
    if (is_right(slots[slot].name)) return slot;
  }
  return std::nullopt;
}

}  // namespace

const std::vector<Parameter>& medium_parameters() {
  static const std::vector<Parameter> parameters{
      {Parameter::kSigmaT}, {Parameter::kAlbedo}, {Parameter::kPhase}};
  return parameters;
}

std::string name_of(const Parameter& parameter) {
  switch (parameter.kind) {
    case Parameter::kSigmaT: return "sigma_t";
    case Parameter::kAlbedo: return "albedo";
    case Parameter::kPhase: return slots_of<PhaseFunction>().at(parameter.slot).name;
    case Parameter::kBoundary: return slots_of<Boundary>().at(parameter.slot).name;
    case Parameter::kReflectance:
      return fmt::format("surface[{}].{}", parameter.index,
                         slots_of<Reflectance>().at(parameter.slot).name);
    case Parameter::kLightPlace:
      return fmt::format("light[{}].{}", parameter.index,
                         slots_of<LightDescription>().at(parameter.slot).name);
    case Parameter::kLightScale: return fmt::format("light[{}].scale", parameter.index);
    case Parameter::kScattered: return fmt::format("scattered[{}].scale", parameter.index);
  }
  throw Error(ErrorKind::kInternal, "a parameter of no kind");
}

std::vector<std::string> parameter_names() {
  std::vector<std::string> names = {"sigma_t", "albedo"};
  for (const Slot& slot : slots_of<PhaseFunction>()) names.push_back(slot.name);
  for (const Slot& slot : slots_of<Boundary>()) names.push_back(slot.name);
  for (const Slot& slot : slots_of<Reflectance>()) names.push_back("surface[K]." + slot.name);
  names.emplace_back("light[K].scale");
  for (const Slot& slot : slots_of<LightDescription>()) names.push_back("light[K]." + slot.name);
  names.emplace_back("scattered[K].scale");
  return names;
}

Parameter parameter_named(std::string_view name) {
  for (const Parameter& parameter : medium_parameters()) {
    if (name == name_of(parameter)) return parameter;
  }
  uint32_t index = 0;
  const auto is_name = [&](const std::string& slot) { return slot == name; };
  const auto is_of = [&](std::string_view prefix) {
    return [&, prefix](const std::string& slot) { return read_indexed(name, prefix, slot, index); };
  };
  if (const auto slot = find_slot<PhaseFunction>(is_name)) return {Parameter::kPhase, 0, *slot};
  if (const auto slot = find_slot<Boundary>(is_name)) return {Parameter::kBoundary, 0, *slot};
  if (const auto slot = find_slot<Reflectance>(is_of("surface["))) {
    return {Parameter::kReflectance, index, *slot};
  }
  if (const auto slot = find_slot<LightDescription>(is_of("light["))) {
    return {Parameter::kLightPlace, index, *slot};
  }
  if (read_indexed(name, "light[", "scale", index)) return {Parameter::kLightScale, index};
  if (read_indexed(name, "scattered[", "scale", index)) return {Parameter::kScattered, index};
  throw invalid_input(fmt::format("{} is not a parameter; there are {}, K counting from 0", name,
                                  fmt::join(parameter_names(), ", ")));
}

}  // namespace itn::tracer
