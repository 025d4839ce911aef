// The networks and tables of Che et al. 2020, by one command.
#pragma once

#include <string>

#include "client/commands/options.h"

namespace itn {

struct ExperimentOptions {
  std::string file, preset, folder;
  bool print_config = false;
  bool status = false;
  bool tables = false;
  int torch_threads = 0;
  WorkerFlags workers;
};

void run_experiment(const ExperimentOptions& options);

}  // namespace itn
