// Experiment files: what networks are trained on what, and compared how.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "itn/v1/experiment.pb.h"

namespace itn {

// With all defaults. Throws as load_experiment() and find_preset()
// (client/presets/presets.h).
v1::Experiment experiment_of_preset(std::string_view name);

// Reads an experiment file; with all defaults, and validated. Throws Error: kIo; kInvalidInput with
// file, line and column, or with the file and the field that is out of range.
v1::Experiment load_experiment(const std::filesystem::path& path);

// What a network is trained by, from its own start on: `steps`, the schedule and the augmentation
// of all, its own loss and parameterization. `rate`: that of the search.
v1::TrainingConfig own_training(const v1::Experiment& experiment,
                                const v1::ExperimentNetwork& network, double rate);

// The training that a network shares with others: an RN of shared_steps. Networks for which this is
// equal share it.
v1::TrainingConfig shared_training(const v1::Experiment& experiment,
                                   const v1::ExperimentNetwork& network, double rate);

// What a learning rate is tried by: an RN, otherwise the first network.
v1::TrainingConfig search_training(const v1::Experiment& experiment, double rate);

// The learning rate without a search.
double configured_rate(const v1::Experiment& experiment);

// The name as a file's: "ITN+similar+map" is "itn_similar_map".
std::string file_name_of(const std::string& network);

}  // namespace itn
