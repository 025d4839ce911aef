// Configurations of training to start from.
#pragma once

#include <filesystem>
#include <string_view>

#include "itn/v1/learning.pb.h"

namespace itn {

// The preset of this name (client/presets/presets.h). Throws as find_preset().
v1::TrainingConfig training_preset(std::string_view name);

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
