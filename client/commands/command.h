// The subcommands of `itn`. Each adds itself with its flags; its callback does the work and throws
// Error for anything the user can act on.
//
// stdout carries results (JSON with --json), stderr progress and logs.
#pragma once

#include <CLI/CLI.hpp>

#include <string>

#include "common/error.h"

namespace itn {

void add_render_command(CLI::App& app);
void add_shapes_command(CLI::App& app);
void add_materials_command(CLI::App& app);
void add_import_command(CLI::App& app);
void add_probe_command(CLI::App& app);
void add_relay_command(CLI::App& app);
void add_dataset_command(CLI::App& app);
void add_models_command(CLI::App& app);
void add_completion_command(CLI::App& app);

// Their flags alone are here. What they do needs a network, or reads photographs: run_predict() and
// so on, in the program itn-learn.
void add_predict_command(CLI::App& app);
void add_train_command(CLI::App& app);
void add_evaluate_command(CLI::App& app);
void add_experiment_command(CLI::App& app);
void add_export_command(CLI::App& app);
void add_light_command(CLI::App& app);
void add_merge_command(CLI::App& app);
void add_refine_command(CLI::App& app);
void add_fit_command(CLI::App& app);

// Throws Error (kUsage) otherwise.
inline void require_usage(bool condition, const std::string& message) {
  if (!condition) throw Error(ErrorKind::kUsage, message);
}

}  // namespace itn
