#include "client/training/training_config.h"

#include "client/presets/presets.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/read_file.h"

namespace itn {
v1::TrainingConfig training_preset(std::string_view name) {
  const Preset& preset = find_preset(training_presets(), name);
  v1::TrainingConfig config;
  parse_text_proto(std::string(preset.file), std::string(name), config);
  return config;
}

v1::TrainingConfig overridden(v1::TrainingConfig config, const v1::TrainingConfig& given) {
  if (given.has_architecture()) config.clear_architecture();
  if (given.augmentation().has_noise()) config.mutable_augmentation()->clear_noise();
  config.MergeFrom(given);
  return config;
}

void clear_unused_loss_fields(v1::TrainingConfig& config) {
  if (config.loss() != v1::TrainingConfig::ITN) {
    config.clear_lambda();
    config.clear_image_weights();
    config.clear_spp();
    config.clear_estimates();
    config.clear_pilot_spp();
  }
}

v1::TrainingConfig read_training_config(const std::filesystem::path& file,
                                        const v1::TrainingConfig& preset) {
  v1::TrainingConfig given;
  parse_text_proto(read_file(file, "configuration"), file.string(), given);
  return overridden(preset, given);
}

}  // namespace itn
