// itn export: its flags.
#include <memory>

#include "client/commands/command.h"
#include "client/commands/export.h"
#include "client/commands/options.h"
#include "common/flags.h"

namespace itn {
void add_export_command(CLI::App& app) {
  const auto options = std::make_shared<ModelExportOptions>();
  CLI::App* command = app.add_subcommand(
      "export", "Write a trained model as a file for prediction, without what training needs");
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
  command->callback([options] { run_export(*options); });
}

}  // namespace itn
