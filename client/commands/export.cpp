// itn export: a trained model as a file for prediction.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/dataset/dataset.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "client/training/finalize_model.h"
#include "client/training/packed_inputs.h"
#include "client/training/training_set.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/learning/checkpoint.h"
#include "common/learning/model_files.h"
#include "common/learning/predictor.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

struct ExportCommand {
  std::string checkpoint;
  std::string output;
  std::string name, version;
  std::string dataset;
  std::optional<double> error_correlation;
};

// The images of a split, as the model is shown them; none if it is empty.
class SplitImages {
 public:
  SplitImages(DatasetReader& dataset, v1::Split split, const v1::Model& model,
              const fs::path& folder) {
    if (dataset.items(split).empty()) return;
    labelled_ = images_of(dataset, split);
    inputs_.emplace(
        labelled_,
        PackedFormat{.resolution = static_cast<int>(model.resolution()), .input = model.input()},
        folder, interruption());
  }

  ImageSource source() const { return inputs_ ? source_of(*inputs_) : ImageSource(); }
  HeldOutImages held_out() const { return {source(), labelled_.truth}; }

 private:
  LabelledImages labelled_;
  std::optional<PackedInputs> inputs_;
};

// From the training split and, as held out, the validation split.
void measure_on_dataset(const ExportCommand& options, v1::Model& model) {
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

void run(const ExportCommand& options) {
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

}  // namespace

void add_export_command(CLI::App& app) {
  const auto options = std::make_shared<ExportCommand>();
  CLI::App* command = add_learning_command(app, "export");
  command
      ->add_option(
          "checkpoint", options->checkpoint,
          "Checkpoint, folder of a run (its last model; RUN/best.itn is its best), or name "
          "of a model that itn models lists")
      ->required();
  command->add_option("-o,--output", options->output, "File to write")->required();
  command->add_option("--model-name", options->name, "What answers call it; default: as before")
      ->check(kModelName);
  command
      ->add_option("--model-version", options->version,
                   "What answers say of its version, e.g. 1.2.0; default: as before")
      ->check(kModelName);
  command->add_option(
      "--dataset", options->dataset,
      "Folder of a dataset like that of the training: its training split tells the model what it "
      "has seen, so that it will know what it has not; its validation split, of 256 images at "
      "least, how wide its answers must be; a run does so at its end");
  command
      ->add_option("--error-correlation,--common-error", options->error_correlation,
                   "Correlation of the errors in two images of one object, for itn predict "
                   "--one-material; default: as before")
      ->check(number_in(0.0, 1.0));
  command->callback([options] { run(*options); });
}

}  // namespace itn
