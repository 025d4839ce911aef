// What itn and itn-learn have in common: flags, messages and exit codes of a command line.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace itn {

// Parses the arguments and runs the command that they name. `add_commands` adds the commands.
// Returns the exit code (common/error.h), once stdout is known to be written.
int run_command_line(int argc, char** argv, const std::function<void(CLI::App&)>& add_commands);

// Arguments in which a list may have spaces about its commas, as in `--workers a, b`: made one
// word.
std::vector<std::string> with_lists_joined(const CLI::App& app,
                                           const std::vector<std::string>& arguments);

// What is wrong with the first list (of flags, with its lists joined) that has an entry without
// anything in it, as in "1,,2"; empty if none has.
std::string empty_entry(const CLI::App& app, const std::vector<std::string>& arguments);

// What is wrong with the first command or flag that there is not, and which one may have been
// meant; empty if all exist.
std::string unknown_name(const CLI::App& app, const std::vector<std::string>& arguments);

}  // namespace itn
