#include "client/learning_program.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "common/error.h"
#include "common/files/read_file.h"
#include "common/passive_waiting.h"

namespace itn {
namespace fs = std::filesystem;

void become_learning_program() {
  const fs::path program = fs::read_symlink("/proc/self/exe").parent_path() / "itn-learn";
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

}  // namespace itn
