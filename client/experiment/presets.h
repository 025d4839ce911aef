// The experiments that come with itn, as files.
#pragma once

#include <span>
#include <string_view>

namespace itn {

struct ExperimentPreset {
  std::string_view name;
  std::string_view description;  // one line
  std::string_view file;         // an experiment file, with comments
};

// "smoke": whether everything works, in less than a minute. "small": results that mean something,
// in less than an hour. "paper": the protocol of Che et al. 2020, in days; "paper_64": at 64
// pixels.
std::span<const ExperimentPreset> experiment_presets();

// Throws Error (invalid input) that lists the names there are.
const ExperimentPreset& find_experiment_preset(std::string_view name);

}  // namespace itn
