// The parts of a training run with a dataset, from which `itn train` and experiments put theirs
// together.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>

#include "client/dataset/dataset.h"
#include "client/render_pool/render_pool.h"
#include "client/training/image_source.h"
#include "client/training/packed_inputs.h"
#include "client/training/training.h"
#include "client/training/training_run.h"
#include "client/training/training_set.h"
#include "client/training/validation.h"

namespace itn {

// Images that are not learned from.
struct ValidationSet {
  // `folder`: where their packed form is. `noise`: as in Validation.
  ValidationSet(LabelledImages labelled, const PackedFormat& format,
                const std::filesystem::path& folder, double noise, const std::stop_token& stop);

  LabelledImages images;
  PackedInputs inputs;
  Validation validation;
};

// The set of the dataset's validation split; null if it has none.
std::unique_ptr<ValidationSet> validation_set(DatasetReader& dataset, const PackedFormat& format,
                                              const std::filesystem::path& folder, double noise,
                                              const std::stop_token& stop);

// Pixels a side that the network sees of images of so many.
int resolution_of(const v1::TrainingConfig& config, int images);

// The model that a new run starts from: `fitted` (fit_model()), or `init` with its weights. One
// that goes on from a model of the other exposure sees images on the scale of these, whose mean is
// 1 in both cases.
v1::Model start_model(const std::optional<v1::Model>& init, const v1::Model& fitted,
                      const v1::DatasetConfig& images);

// Completes a model whose run is over (TrainingRun::complete). `images`: those of training. The
// validation set, which may be null, must outlive it.
std::function<void(v1::Model&)> completion(ImageSource images, const ValidationSet* validation,
                                           std::stop_token stop);

// What the loss of the configuration needs; empty for RN. `pool`: called if something is rendered;
// what it returns must outlive the result.
RerenderingEvaluator image_term_of(const v1::TrainingConfig& config,
                                   const std::function<RenderPool&()>& pool, std::stop_token stop);

}  // namespace itn
