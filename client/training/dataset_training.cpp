#include "client/training/dataset_training.h"

#include <utility>

#include "client/dataset/dataset_config.h"
#include "client/training/finalize_model.h"
#include "client/training/rerendering_loss.h"

namespace itn {

ValidationSet::ValidationSet(LabelledImages labelled, const PackedFormat& format,
                             const std::filesystem::path& folder, double noise,
                             const std::stop_token& stop)
    : images(std::move(labelled)),
      inputs(images, format, folder, stop),
      validation(images, inputs, noise) {}

std::unique_ptr<ValidationSet> validation_set(DatasetReader& dataset, const PackedFormat& format,
                                              const std::filesystem::path& folder, double noise,
                                              const std::stop_token& stop) {
  if (dataset.items(v1::SPLIT_VALIDATION).empty()) return nullptr;
  return std::make_unique<ValidationSet>(images_of(dataset, v1::SPLIT_VALIDATION), format, folder,
                                         noise, stop);
}

int resolution_of(const v1::TrainingConfig& config, int images) {
  return config.resolution() != 0 ? static_cast<int>(config.resolution()) : images;
}

v1::Model start_model(const std::optional<v1::Model>& init, const v1::Model& fitted,
                      const v1::DatasetConfig& images) {
  v1::Model model = init ? *init : fitted;
  if (init) model.clear_version();  // it was that one's
  if (model.exposure() != fitted.exposure()) {
    model.set_exposure(fitted.exposure());
    model.set_image_scale(fitted.image_scale());
  }
  model.set_irradiance(common_irradiance(images));
  return model;
}

std::function<void(v1::Model&)> completion(ImageSource images, const ValidationSet* validation,
                                           std::stop_token stop) {
  return [images = std::move(images), validation, stop = std::move(stop)](v1::Model& model) {
    finalize_model(images,
                   validation != nullptr
                       ? HeldOutImages{source_of(validation->inputs), validation->images.truth}
                       : HeldOutImages{},
                   model, stop);
  };
}

RerenderingEvaluator image_term_of(const v1::TrainingConfig& config,
                                   const std::function<RenderPool&()>& pool, std::stop_token stop) {
  if (config.loss() != v1::TrainingConfig::ITN) return {};
  return pool_rerendering(
      pool(),
      {.spp = config.spp(), .estimates = config.estimates(), .pilot_spp = config.pilot_spp()},
      std::move(stop));
}

}  // namespace itn
