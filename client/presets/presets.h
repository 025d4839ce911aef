// The configurations that come with itn: text files beside this one, which are compiled in.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace itn {

struct Preset {
  std::string_view name;
  std::string_view file;  // protobuf text format, which opens with a comment "NAME: DESCRIPTION"

  std::string_view description() const;  // one line
};

// itn.v1.DatasetConfig.
std::span<const Preset> dataset_presets();
// itn.v1.TrainingConfig, without steps, dataset and threads.
std::span<const Preset> training_presets();
// itn.v1.Experiment.
std::span<const Preset> experiment_presets();

// Throws Error (invalid input) that lists the names there are.
const Preset& find_preset(std::span<const Preset> presets, std::string_view name);

std::vector<std::string> names_of(std::span<const Preset> presets);

// Names and descriptions, for --help.
std::string description_of(std::span<const Preset> presets);

// What dataset files leave out of what they have: an itn.v1.DatasetConfig.
std::string_view dataset_defaults();

}  // namespace itn
