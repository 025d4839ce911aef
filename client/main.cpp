// itn: the command line. LibTorch takes half a second and 150 MB to load, so the commands that need
// a network are in a program of their own, itn-learn: itn becomes it when one of them is called.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <span>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "client/command_line.h"
#include "client/commands/command.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/passive_waiting.h"

namespace itn {
namespace {

bool is_learning_command(std::span<char*> arguments) {
  const auto name = std::ranges::find_if(arguments, [](const char* a) { return a[0] != '-'; });
  return name != arguments.end() &&
         std::ranges::any_of(kLearningCommands,
                             [&](const LearningCommand& c) { return c.name == *name; });
}

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

void add_commands(CLI::App& app) {
  add_render_command(app);
  add_shapes_command(app);
  add_probe_command(app);
  add_dataset_command(app);
  add_models_command(app);
  for (const LearningCommand& command : kLearningCommands) {
    add_learning_command(app, command.name);  // for --help and suggestions
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
