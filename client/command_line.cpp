#include "client/command_line.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <iterator>
#include <numeric>

#include "client/interrupt.h"
#include "client/output.h"
#include "client/progress.h"
#include "common/error.h"
#include "common/flags.h"
#include "common/logging.h"
#include "common/rpc/library_log.h"
#include "common/suggestion.h"

namespace itn {
namespace {

using Arguments = std::vector<std::string>;

int fail(ErrorKind kind, const std::string& message) {
  std::fprintf(stderr, "itn: %s\n", for_terminal(message).c_str());
  return exit_code(kind);
}

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

// The end if there is none.
Arguments::const_iterator find_command_name(const Arguments& arguments) {
  return std::ranges::find_if(arguments, [](const auto& a) { return !a.starts_with('-'); });
}

// The command that the arguments name; nullptr if there is none of this name.
const CLI::App* command_of(const CLI::App& app, const Arguments& arguments) {
  const auto name = find_command_name(arguments);
  if (name == arguments.end()) return nullptr;
  const auto commands = commands_of(app);
  const auto found = std::ranges::find(commands, *name, [](auto* c) { return c->get_name(); });
  return found == commands.end() ? nullptr : *found;
}

// --- Lists ---

bool is_list(const CLI::App& command, const std::string& argument) {
  const CLI::Option* option = command.get_option_no_throw(flag_of(argument));
  return option != nullptr && option->get_delimiter() == ',';
}

std::string without_spaces_at_commas(const std::string& list) {
  std::string result;
  for (const char c : list) {
    if (c == ',') result.erase(result.find_last_not_of(' ') + 1);
    if (c != ' ' || (!result.empty() && result.back() != ',')) result += c;
  }
  return result;
}

// --- Names ---

Arguments names_of_commands(const CLI::App& app) {
  Arguments names;
  for (const CLI::App* command : commands_of(app)) names.push_back(command->get_name());
  return names;
}

void set_quiet() {
  silence_progress();
  spdlog::set_level(spdlog::level::warn);
}

int parse_and_run(CLI::App& app, Arguments arguments) {
  arguments = with_lists_joined(app, arguments);
  if (const std::string wrong = empty_entry(app, arguments); !wrong.empty()) {
    return fail(ErrorKind::kUsage, wrong);
  }
  try {
    app.parse(Arguments(arguments.rbegin(), arguments.rend()));  // which it wants reversed
    if (!app.get_subcommands().empty()) return 0;
    std::fprintf(stderr, "%s", app.help().c_str());
    return exit_code(ErrorKind::kUsage);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    const std::string unknown = unknown_name(app, arguments);
    return fail(ErrorKind::kUsage, (unknown.empty() ? message_of(error) : unknown) +
                                       "\nRun with --help for more information.");
  }
}

}  // namespace

Arguments with_lists_joined(const CLI::App& app, const Arguments& arguments) {
  const CLI::App* command = command_of(app, arguments);
  if (command == nullptr) return arguments;
  Arguments result;
  for (size_t i = 0; i < arguments.size(); ++i) {
    result.push_back(arguments[i]);
    if (!is_list(*command, arguments[i])) continue;
    if (arguments[i].find('=') == std::string::npos) {
      if (++i == arguments.size()) break;
      result.push_back(arguments[i]);
    }
    std::string& list = result.back();
    while (i + 1 < arguments.size() && (list.ends_with(',') || arguments[i + 1].starts_with(','))) {
      list += arguments[++i];
    }
    list = without_spaces_at_commas(list);
  }
  return result;
}

std::string empty_entry(const CLI::App& app, const Arguments& arguments) {
  const CLI::App* command = command_of(app, arguments);
  if (command == nullptr) return "";
  for (size_t i = 0; i < arguments.size(); ++i) {
    if (!is_list(*command, arguments[i])) continue;
    const std::string flag = flag_of(arguments[i]);
    const bool follows = flag == arguments[i];
    if (follows && ++i == arguments.size()) break;
    const std::string list = follows ? arguments[i] : arguments[i].substr(flag.size() + 1);
    if (list.starts_with(',') || list.ends_with(',') || list.find(",,") != std::string::npos) {
      return fmt::format("{} {}: an entry of the list is empty", flag, list);
    }
  }
  return "";
}

std::string unknown_name(const CLI::App& app, const Arguments& arguments) {
  const auto name = find_command_name(arguments);
  const CLI::App* command = command_of(app, arguments);
  if (name != arguments.end() && command == nullptr) {
    return fmt::format("there is no command {}{}", *name,
                       suggestion(*name, names_of_commands(app)));
  }
  for (const std::string& argument : arguments) {
    if (!is_unknown_flag(app, argument)) continue;
    const std::string flag = flag_of(argument);
    if (command == nullptr) {
      return fmt::format("there is no flag {}{}", flag, suggestion(flag, names_of_flags(app)));
    }
    if (is_unknown_flag(*command, argument)) {
      return fmt::format("itn {} has no flag {}{}", command->get_name(), flag,
                         suggestion(flag, names_of_flags(*command)));
    }
  }
  return "";
}

int run_command_line(int argc, char** argv, const std::function<void(CLI::App&)>& add_commands) {
  try {
    watch_interrupts();
    std::signal(SIGPIPE, SIG_IGN);  // a reader that has gone is an error of the write
    std::signal(SIGXFSZ, SIG_IGN);  // so is a size that the user's files may not have (ulimit -f)
    set_up_logging();
    log_libraries_through_spdlog();
    CLI::App app("Renders translucent objects and finds the optical parameters of their material.",
                 "itn");
    app.require_subcommand(0, 1);
    app.set_version_flag("--version", "itn " ITN_VERSION);
    add_commands(app);
    constexpr const char* kQuiet = "No progress; results, warnings and errors alone";
    app.add_flag_callback("-q,--quiet", set_quiet, kQuiet);
    for (CLI::App* command : app.get_subcommands({})) {
      command->add_flag_callback("-q,--quiet", set_quiet, kQuiet);
    }
    const int code = parse_and_run(app, Arguments(argv + 1, argv + argc));
    finish_output();
    return code;
  } catch (const Error& error) {
    return fail(error.kind(), error.what());
  } catch (const std::exception& error) {
    return fail(ErrorKind::kInternal, error.what());
  }
}

}  // namespace itn
