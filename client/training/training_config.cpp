#include "client/training/training_config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/read_file.h"

namespace itn {
namespace {

v1::TrainingConfig paper() {
  v1::TrainingConfig config;
  config.set_loss(v1::TrainingConfig::RN);
  config.set_parameterization(v1::SIMILARITY);
  config.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(16);
  config.set_output(v1::POINT);
  config.set_input(v1::LUMINANCE_AND_WEIGHT);
  config.set_exposure(v1::EXPOSURE_KNOWN);
  config.set_batch(60);
  config.set_optimizer(v1::TrainingConfig::ADAM);
  config.set_learning_rate(1e-4);
  config.set_schedule(v1::TrainingConfig::CONSTANT);
  config.set_spp(256);
  config.set_estimates(4);
  config.set_pilot_spp(4);
  return config;
}

v1::TrainingConfig residual() {
  v1::TrainingConfig config = paper();
  config.set_parameterization(v1::UNBOUNDED);
  auto& layers = *config.mutable_architecture()->mutable_residual_convolutions();
  layers.set_base_channels(32);
  layers.set_blocks(1);
  config.set_output(v1::GAUSSIAN);
  config.set_input(v1::RATIOS);
  config.set_mean_weight(2);
  config.set_batch(32);
  config.set_optimizer(v1::TrainingConfig::MUON);
  config.set_learning_rate(4e-3);
  config.set_schedule(v1::TrainingConfig::COSINE);
  config.set_warmup_steps(200);
  config.set_weight_decay(0.02);
  config.set_max_gradient_norm(5);
  config.set_weight_average_decay(0.999);
  v1::Augmentation& augmentation = *config.mutable_augmentation();
  augmentation.set_mirror(true);
  augmentation.set_shift(2);
  augmentation.mutable_noise()->set_min(0.2);
  augmentation.mutable_noise()->set_max(0.2);
  return config;
}

}  // namespace

std::vector<std::string> training_presets() {
  return {"paper", "residual"};
}

v1::TrainingConfig training_preset(const std::string& name) {
  if (name == "paper") return paper();
  if (name == "residual") return residual();
  throw invalid_input(fmt::format("there is no preset \"{}\"; there are {}", name,
                                  fmt::join(training_presets(), ", ")));
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
