// What itn does of the commands that need a network: it becomes itn-learn, which does them.
// LibTorch takes half a second and 150 MB to load; help and mistakes do without.
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "client/commands/evaluate.h"
#include "client/commands/experiment.h"
#include "client/commands/export.h"
#include "client/commands/fit.h"
#include "client/commands/light.h"
#include "client/commands/merge.h"
#include "client/commands/predict.h"
#include "client/commands/refine.h"
#include "client/commands/train.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/passive_waiting.h"

namespace itn {
namespace {

// Runs itn-learn, which lies in the folder of this program, with the arguments of this process in
// its place. Throws Error (kIo) if it cannot be run.
[[noreturn]] void become_learning_program() {
  const std::filesystem::path program =
      std::filesystem::read_symlink("/proc/self/exe").parent_path() / "itn-learn";
  std::vector<std::string> arguments;
  std::istringstream command_line(read_file("/proc/self/cmdline", "command line"));
  for (std::string argument; std::getline(command_line, argument, '\0');) {
    arguments.push_back(argument);
  }
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  wait_passively();
  ::execv(program.c_str(), argv.data());
  const int error_number = errno;
  throw Error(
      ErrorKind::kIo,
      fmt::format("networks are the part of the program itn-learn, which belongs beside itn; "
                  "cannot run {}: {}",
                  program.string(),
                  std::error_code(error_number, std::generic_category()).message()));
}

}  // namespace

void run_predict(const PredictOptions& /*options*/) {
  become_learning_program();
}
void run_fit(const FitOptions& /*options*/) {
  become_learning_program();
}
void run_refine(const RefineOptions& /*options*/) {
  become_learning_program();
}
void run_train(const TrainOptions& /*options*/, const CLI::App& /*command*/) {
  become_learning_program();
}
void run_evaluate(const EvaluateOptions& /*options*/) {
  become_learning_program();
}
void run_experiment(const ExperimentOptions& /*options*/) {
  become_learning_program();
}
void run_export(const ModelExportOptions& /*options*/) {
  become_learning_program();
}
void run_light(const LightOptions& /*options*/) {
  become_learning_program();
}
void run_merge(const MergeOptions& /*options*/) {
  become_learning_program();
}

}  // namespace itn
