// The subcommands of `itn`. Each adds itself with its flags; its callback does the work and throws
// Error for anything the user can act on.
//
// stdout carries results (JSON with --json), stderr progress and logs.
#pragma once

#include <CLI/CLI.hpp>

#include <algorithm>
#include <string>
#include <string_view>

#include "common/error.h"

namespace itn {

void add_render_command(CLI::App& app);
void add_shapes_command(CLI::App& app);
void add_probe_command(CLI::App& app);
void add_dataset_command(CLI::App& app);

void add_models_command(CLI::App& app);

// In itn-learn alone: what needs a network, or reads photographs. itn knows their names and what
// they are for.
struct LearningCommand {
  std::string_view name;
  const char* description;
};
inline constexpr LearningCommand kLearningCommands[] = {
    {"predict", "Optical parameters of the object in a photograph, or in many"},
    {"refine", "Refine a material until renders of a known scene are like the image"},
    {"train", "Train a network with a dataset; the same command continues what was stopped"},
    {"evaluate", "Errors of trained networks on a dataset, beside the constant predictor"},
    {"experiment", "The networks and tables of Che et al. 2020; the same command continues"},
    {"export", "Write a trained model as a file for prediction, without what training needs"},
    {"merge", "Photographs of a scene at several exposures, from a tripod, as one linear EXR"},
    {"completion", "Print a script that completes commands and flags in a shell"},
};

// One of them, with its description. The name must be in the list.
inline CLI::App* add_learning_command(CLI::App& app, std::string_view name) {
  const auto* const command = std::ranges::find(kLearningCommands, name, &LearningCommand::name);
  return app.add_subcommand(std::string(name), command->description);
}

void add_predict_command(CLI::App& app);
void add_train_command(CLI::App& app);
void add_evaluate_command(CLI::App& app);
void add_experiment_command(CLI::App& app);
void add_export_command(CLI::App& app);
void add_merge_command(CLI::App& app);
void add_refine_command(CLI::App& app);
void add_completion_command(CLI::App& app);

// Throws Error (kUsage) otherwise.
inline void require_usage(bool condition, const std::string& message) {
  if (!condition) throw Error(ErrorKind::kUsage, message);
}

}  // namespace itn
