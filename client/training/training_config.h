// Configurations of training to start from.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "itn/v1/learning.pb.h"

namespace itn {

// "paper": Che et al., ICCP 2020: their encoder and optimizer, the RN loss. "residual": what we
// found to learn most in the least time: a residual network with a Gaussian output, its images
// mirrored, shifted and brought up to a common noise; Muon with a cosine schedule; the running
// mean of the weights.
std::vector<std::string> training_presets();

// Without steps, dataset and threads. Throws Error (invalid input) unless there is one of this
// name.
v1::TrainingConfig training_preset(const std::string& name);

// `config` with the fields that `given` has in the place of its own; of layers and noise all of
// them.
v1::TrainingConfig overridden(v1::TrainingConfig config, const v1::TrainingConfig& given);

// Clears what says nothing with the loss and image term that the configuration has.
void clear_unused_loss_fields(v1::TrainingConfig& config);

// The preset with the fields that the file, protobuf text format of TrainingConfig, has. Throws
// Error: kIo; kInvalidInput with line and column.
v1::TrainingConfig read_training_config(const std::filesystem::path& file,
                                        const v1::TrainingConfig& preset);

}  // namespace itn
