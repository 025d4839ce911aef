// The command itn train, which teaches an encoder network with a dataset.
#pragma once

#include <CLI/CLI.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/options.h"

namespace itn {

// The flags. Those that were given change the training configuration, whose fields are documented
// in itn/v1/learning.proto.
struct TrainOptions {
  std::string dataset;
  std::string folder;
  std::string preset = "paper";
  std::string config;  // file
  bool print_config = false;
  std::string loss, parameterization, distribution, exposure, architecture, schedule, precision,
      optimizer, image_weights;
  std::string init;
  std::string model_name, model_version;
  uint32_t resolution = 0;
  std::optional<uint64_t> steps;
  std::optional<double> epochs;
  uint32_t batch = 0, base_channels = 0, blocks = 0, spp = 0, estimates = 0, pilot_spp = 0;
  double learning_rate = 0, weight_decay = 0, max_gradient_norm = 0, weight_average = 0;
  uint64_t warmup_steps = 0, seed = 0;
  std::optional<double> lambda;
  std::vector<double> noise;  // one level, or the lowest and the highest
  double exposure_jitter = 0;
  double first_order_step = 0;
  double mean_weight = 0;
  bool mirror = false;
  bool camera = false;
  uint32_t shift = 0;
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
