// itn evaluate: its flags.
#include <memory>

#include "client/commands/command.h"
#include "client/commands/evaluate.h"
#include "client/commands/options.h"
#include "common/flags.h"

namespace itn {
void add_evaluate_command(CLI::App& app) {
  const auto options = std::make_shared<EvaluateOptions>();
  CLI::App* command = app.add_subcommand(
      "evaluate", "Errors of trained networks on a dataset, beside the constant predictor");
  command
      ->add_option("checkpoints", options->checkpoints,
                   "Checkpoints, folders of runs, or models that itn models lists")
      ->required();
  command->add_option("--dataset", options->dataset, "Folder that itn dataset wrote")->required();
  command->add_option("--split", options->split, "Images to evaluate on")
      ->check(one_of({"test", "validation", "train"}))
      ->capture_default_str();
  command
      ->add_option("--rerender", options->rerender,
                   "Images to render again with every prediction, for the image error")
      ->check(number_in(0U, UINT32_MAX))
      ->capture_default_str();
  command->add_option("--spp", options->spp, "Samples per pixel of these renders")
      ->check(kSppRange)
      ->capture_default_str();
  command->add_option("--picture", options->picture,
                      "PNG to write: input, re-rendering by the first checkpoint, difference");
  command->add_option("--picture-items", options->picture_items, "Rows of the picture")
      ->check(number_in(1U, 100U))
      ->capture_default_str();
  command
      ->add_option("--examples", options->examples,
                   "Answers of the first checkpoint to print beside their truth")
      ->check(number_in(0U, 1000U))
      ->capture_default_str();
  command->add_flag(
      "--noise-levels", options->noise_levels,
      "Evaluate each network also with noise added up to the level that it was trained "
      "at (itn train --add-noise), and up to half of that");
  command->add_flag("--shifts", options->shifts,
                    "Evaluate each network also on images that differ as photographs do: in white "
                    "balance, contrast, blur, what is clipped, and more");
  command->add_flag("--one-material", options->one_material,
                    "Evaluate each network also with what it says of all images of an object "
                    "together (itn dataset --views)");
  add_format_flags(*command, options->json, "itn.v1.Evaluation");
  add_worker_flags(*command, options->workers);
  command->callback([options] { run_evaluate(*options); });
}

}  // namespace itn
