// The subcommands of `itn`. Each adds itself with its flags; its callback does the work and throws
// Error for anything the user can act on.
//
// stdout carries results (JSON with --json), stderr progress and logs.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include "common/image/photograph.h"
#include "itn/v1/predict.pb.h"

namespace itn {

void add_render_command(CLI::App& app);
void add_shapes_command(CLI::App& app);
void add_probe_command(CLI::App& app);
void add_dataset_command(CLI::App& app);

void add_models_command(CLI::App& app);

// Answers photographs that are framed: an outcome for each.
using Predict = std::function<v1::PredictBatchReply(std::span<const FramedPhotograph>)>;
// By the network in the file or folder `model`, in this process.
using LoadPredictor = Predict(const std::filesystem::path& model);
// `here` is nullptr in a program without networks, which then becomes the one with them.
void add_predict_command(CLI::App& app, LoadPredictor* here);

// In itn-learn alone.
void add_train_command(CLI::App& app);
void add_evaluate_command(CLI::App& app);
void add_export_command(CLI::App& app);
void add_merge_command(CLI::App& app);
void add_completion_command(CLI::App& app);
LoadPredictor predict_here;

}  // namespace itn
