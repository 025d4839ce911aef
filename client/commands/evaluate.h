// Errors of trained networks on a split, beside the constant predictor.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/commands/options.h"

namespace itn {

struct EvaluateOptions {
  std::vector<std::string> checkpoints;
  std::string dataset;
  std::string split = "test";
  uint32_t rerender = 0;
  uint32_t spp = 256;
  std::string picture;
  uint32_t picture_items = 2;
  uint32_t examples = 0;
  WorkerFlags workers;
  bool noise_levels = false;
  bool one_material = false;
  bool shifts = false;
  bool json = false;
};

void run_evaluate(const EvaluateOptions& options);

}  // namespace itn
