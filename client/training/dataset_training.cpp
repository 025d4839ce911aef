#include "client/training/dataset_training.h"

#include <filesystem>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/dataset_config.h"
#include "client/training/finalize_model.h"
#include "client/training/image_source.h"
#include "client/training/rerendering_loss.h"
#include "common/error.h"
#include "common/learning/parameterization.h"
#include "common/random.h"

namespace itn {
namespace {

// A branch of the tree of random choices below a run's seed, beside those of training.cpp.
constexpr uint64_t kLabels = 5;

// `fitted` (fit_model()), or `from` with its weights. One that goes on from a model of the other
// exposure sees images on the scale of these, whose mean is 1 in both cases.
v1::Model start_model(const std::optional<v1::Model>& from, const v1::Model& fitted,
                      const v1::DatasetConfig& images) {
  v1::Model model = from ? *from : fitted;
  if (from) model.clear_version();  // it was that one's
  if (model.exposure() != fitted.exposure()) {
    model.set_exposure(fitted.exposure());
    model.set_image_scale(fitted.image_scale());
  }
  model.set_irradiance(common_irradiance(images));
  return model;
}

// What the network will be shown: one that goes on from a model has its channels.
PackedFormat format_of(const v1::TrainingConfig& config, const LabelledImages& images,
                       const std::optional<v1::Model>& from) {
  return {.resolution = resolution_of(config, images.resolution),
          .input = config.input(),
          .channels = static_cast<int>(from ? channels_of(*from) : images.channels)};
}

// The configuration, once it is valid.
const v1::TrainingConfig& validated(const v1::TrainingConfig& config) {
  validate(config);
  set_torch_threads(static_cast<int>(config.torch_threads()));
  return config;
}

// The images, if a network of this configuration can learn from them.
LabelledImages learnable(LabelledImages images, const v1::TrainingConfig& config) {
  const auto require = [&](bool condition, const char* what) {
    if (images.channels > 1 && !condition) {
      throw invalid_input(fmt::format("the dataset is in colour, which takes {}", what));
    }
  };
  require(config.loss() == v1::TrainingConfig::RN, "the loss RN");
  require(config.input() == v1::RATIOS, "the input RATIOS, as of --preset residual");
  require(config.parameterization() == v1::UNBOUNDED,
          "the parameterization UNBOUNDED, as of --preset residual");
  return images;
}

// The labels that the configuration leaves to them. Runs of one seed have the same.
LabelledImages with_labels(LabelledImages images, const v1::TrainingConfig& config) {
  keep_labels(config.labels(), derive_seed(config.seed(), {kLabels}), images);
  return images;
}

RerenderingEvaluator image_term_of(const v1::TrainingConfig& config,
                                   const std::function<JobRenderer&()>& pool,
                                   std::stop_token stop) {
  if (config.loss() != v1::TrainingConfig::ITN) return {};
  return pool_rerendering(
      pool(),
      {.spp = config.spp(), .estimates = config.estimates(), .pilot_spp = config.pilot_spp()},
      std::move(stop));
}

}  // namespace

int resolution_of(const v1::TrainingConfig& config, int images) {
  return config.resolution() != 0 ? static_cast<int>(config.resolution()) : images;
}

DatasetTraining::ValidationSet::ValidationSet(LabelledImages labelled, const PackedFormat& format,
                                              const TrainingRun& run, double noise)
    : images(std::move(labelled)),
      inputs(images, format, run.folder, run.stop),
      validation(images, inputs, noise) {}

DatasetTraining::DatasetTraining(const v1::TrainingConfig& config, DatasetReader& dataset,
                                 const std::optional<v1::Model>& from, TrainingRun run)
    : config_(validated(config)),
      run_(std::move(run)),
      images_(with_labels(learnable(images_of(dataset, v1::SPLIT_TRAIN), config), config)),
      inputs_(images_, format_of(config, images_, from), run_.folder, run_.stop,
              has_first_order_augmentation(config)) {
  if (run_.validate_every > 0 && !dataset.items(v1::SPLIT_VALIDATION).empty()) {
    validation_ =
        std::make_unique<ValidationSet>(images_of(dataset, v1::SPLIT_VALIDATION), inputs_.format(),
                                        run_, config.augmentation().noise().max());
    run_.validate = [this](const v1::Model& now) { return validation_->validation.measure(now); };
  }
  run_.dataset = std::filesystem::absolute(dataset.folder()).lexically_normal().string();
  run_.complete = [this](v1::Model& model) {
    const HeldOutImages held_out =
        validation_ ? HeldOutImages{source_of(validation_->inputs), validation_->images.truth}
                    : HeldOutImages{};
    finalize_model(source_of(inputs_), held_out, model, run_.stop);
  };
  const v1::DatasetConfig& drawn = dataset.manifest().config();
  start_ = start_model(
      from, fit_model(images_, inputs_.mean_radiance(), material_range(drawn), config), drawn);
  warn_of_albedos_out_of_reach(images_.truth, start_.bounds(), "the network");
}

TrainingEnd DatasetTraining::train(const std::function<JobRenderer&()>& pool) {
  return itn::train(config_, images_, inputs_, start_, image_term_of(config_, pool, run_.stop),
                    run_);
}

}  // namespace itn
