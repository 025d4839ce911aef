// A training run with a dataset: what it reads, what it starts from, and how it is judged.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "client/dataset/dataset.h"
#include "client/render/job_renderer.h"
#include "client/training/packed_inputs.h"
#include "client/training/training_run.h"
#include "client/training/training_set.h"
#include "client/training/validation.h"

namespace itn {

// Pixels a side that the network sees of images of so many.
int resolution_of(const v1::TrainingConfig& config, int images);

class DatasetTraining {
 public:
  // Packs the images of the dataset, which must outlive it, into files in the folder of `run`;
  // those of the validation split, too, if there are any and `run` asks for validations. `from` is
  // the model of the run that goes on, or else one whose weights a new run starts from; a new run
  // without it starts from a new network. Sets the threads of torch. Throws Error as images_of(),
  // PackedInputs, fit_model() and validate() of configurations do.
  DatasetTraining(const v1::TrainingConfig& config, DatasetReader& dataset,
                  const std::optional<v1::Model>& from, TrainingRun run);
  DatasetTraining(const DatasetTraining&) = delete;
  DatasetTraining& operator=(const DatasetTraining&) = delete;

  bool has_validation() const { return validation_ != nullptr; }

  // Trains as itn::train() does. `pool` is called if the loss renders; what it returns must outlive
  // the call.
  TrainingEnd train(const std::function<JobRenderer&()>& pool);

 private:
  // Images that are not learned from.
  struct ValidationSet {
    ValidationSet(LabelledImages labelled, const PackedFormat& format, const TrainingRun& run,
                  double noise);

    LabelledImages images;
    PackedInputs inputs;
    Validation validation;
  };

  v1::TrainingConfig config_;
  TrainingRun run_;
  LabelledImages images_;
  PackedInputs inputs_;
  std::unique_ptr<ValidationSet> validation_;
  v1::Model start_;
};

}  // namespace itn
