// The command itn train, which teaches an encoder network with a dataset.
#pragma once

#include <CLI/CLI.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/config_flags.h"
#include "client/commands/options.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// The flags.
struct TrainOptions {
  explicit TrainOptions(CLI::App& command) : changes(command) {}

  ConfigFlags<v1::TrainingConfig> changes;  // of the configuration that a run starts from
  std::string dataset;
  std::string folder;
  std::string preset = "paper";
  std::string config;  // file
  bool print_config = false;
  std::string init;
  std::string model_name, model_version;
  std::optional<uint64_t> steps;
  std::optional<double> epochs;
  bool camera = false;
  uint64_t checkpoint_every = 100;
  uint64_t validate_every = 500;
  uint64_t patience = 0;
  bool resume = false;
  int torch_threads = 0;
  WorkerFlags workers;
  bool json = false;
};

void run_train(const TrainOptions& given, const CLI::App& command);

}  // namespace itn
