// itn: the command line. Loads no LibTorch: what needs a network is handed over to itn-learn.
#include <algorithm>
#include <cstdio>
#include <span>
#include <string>

#include "client/command_line.h"
#include "client/commands/command.h"
#include "client/learning_program.h"
#include "client/output.h"
#include "common/error.h"

namespace itn {
namespace {

// Commands that are in itn-learn alone; it knows their flags.
struct LearningCommand {
  const char* name;
  const char* description;
};
constexpr LearningCommand kLearningCommands[] = {
    {"predict", "Optical parameters of the object in a photograph, or in many"},
    {"refine", "Refine a material until renders of a known scene are like the image"},
    {"train", "Train a network with a dataset"},
    {"evaluate", "Errors of trained networks on a dataset, beside the constant predictor"},
    {"experiment", "The networks and tables of Che et al. 2020, and a report"},
    {"export", "Write a trained model as a file for prediction"},
    {"merge", "Photographs of a scene at several exposures, from a tripod, as one linear EXR"},
    {"completion", "Print a script that completes commands and flags in a shell"},
};

bool is_learning_command(std::span<char*> arguments) {
  const auto name = std::ranges::find_if(arguments, [](const char* a) { return a[0] != '-'; });
  return name != arguments.end() &&
         std::ranges::any_of(kLearningCommands, [&](const LearningCommand& c) {
           return std::string(*name) == c.name;
         });
}

void add_commands(CLI::App& app) {
  add_render_command(app);
  add_shapes_command(app);
  add_probe_command(app);
  add_dataset_command(app);
  add_models_command(app);
  for (const LearningCommand& command : kLearningCommands) {
    app.add_subcommand(command.name, command.description);  // for --help and suggestions
  }
}

int run(int argc, char** argv) {
  try {
    if (is_learning_command({argv + 1, argv + argc})) become_learning_program();
  } catch (const Error& error) {
    std::fprintf(stderr, "itn: %s\n", for_terminal(error.what()).c_str());
    return exit_code(error.kind());
  }
  return run_command_line(argc, argv, add_commands);
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  return itn::run(argc, argv);
}
