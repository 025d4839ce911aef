#include "client/presets/presets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "common/error.h"

namespace itn {

std::string_view Preset::description() const {
  const std::string_view line = file.substr(0, file.find('\n'));
  return line.substr(line.find(": ") + 2);
}

const Preset& find_preset(std::span<const Preset> presets, std::string_view name) {
  const auto found = std::ranges::find(presets, name, &Preset::name);
  if (found != presets.end()) return *found;
  throw invalid_input(fmt::format("there is no preset \"{}\"; there are {}", name,
                                  fmt::join(names_of(presets), ", ")));
}

std::vector<std::string> names_of(std::span<const Preset> presets) {
  std::vector<std::string> names;
  for (const Preset& preset : presets) names.emplace_back(preset.name);
  return names;
}

std::string description_of(std::span<const Preset> presets) {
  std::vector<std::string> described;
  for (const Preset& preset : presets) {
    described.push_back(fmt::format("{} ({})", preset.name, preset.description()));
  }
  return fmt::format("{}", fmt::join(described, ", "));
}

}  // namespace itn
