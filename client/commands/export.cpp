// itn export: a trained model as a file for prediction.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <thread>

#include "client/commands/export.h"
#include "client/dataset/dataset.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "client/training/finalize_model.h"
#include "client/training/packed_inputs.h"
#include "client/training/training_set.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/checkpoint.h"
#include "common/learning/model_files.h"
#include "common/learning/predictor.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// The images of a split, as the model is shown them; none if it is empty.
class SplitImages {
 public:
  SplitImages(DatasetReader& dataset, v1::Split split, const v1::Model& model,
              const fs::path& folder) {
    if (dataset.items(split).empty()) return;
    labelled_ = images_of(dataset, split);
    inputs_.emplace(labelled_,
                    PackedFormat{.resolution = static_cast<int>(model.resolution()),
                                 .input = model.input(),
                                 .channels = static_cast<int>(channels_of(model))},
                    folder, interruption());
  }

  ImageSource source() const { return inputs_ ? source_of(*inputs_) : ImageSource(); }
  HeldOutImages held_out() const { return {source(), labelled_.truth}; }

 private:
  LabelledImages labelled_;
  std::optional<PackedInputs> inputs_;
};

// From the training split and, as held out, the validation split.
void measure_on_dataset(const ModelExportOptions& options, v1::Model& model) {
  DatasetReader dataset(options.dataset);
  const fs::path folder = fs::absolute(options.output).parent_path();
  const SplitImages training(dataset, v1::SPLIT_TRAIN, model, folder);
  const SplitImages validation(dataset, v1::SPLIT_VALIDATION, model, folder);
  finalize_model(training.source(), validation.held_out(), model, interruption());
  if (!model.has_outlier_model()) {
    throw invalid_input(
        fmt::format("{} has {} images in its training split: too few to say what they are like",
                    options.dataset, training.source().count));
  }
}

}  // namespace

void run_export(const ModelExportOptions& options) {
  check_writable(options.output);
  set_torch_threads(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
  v1::Checkpoint exported;
  v1::Model& model = *exported.mutable_model();
  model = read_checkpoint(find_model(options.checkpoint)).model();
  if (!options.name.empty()) model.set_name(options.name);
  if (!options.version.empty()) model.set_version(options.version);
  if (options.error_correlation) model.set_error_correlation(*options.error_correlation);
  if (!options.dataset.empty()) model.clear_outlier_model();  // it may be of an earlier version
  const Predictor predictor(model);  // it can be used, and so can its new name
  if (!options.dataset.empty()) measure_on_dataset(options, model);
  const bool knows = model.has_outlier_model();
  write_checkpoint(options.output, std::move(exported));
  print_result(
      "{}: {}, {:.1f} MB{}\n", options.output, predictor.name(),
      static_cast<double>(fs::file_size(options.output)) / 1e6,
      knows ? "" : "; it does not know what the images of its training are like (--dataset)");
}

}  // namespace itn
