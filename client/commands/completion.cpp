// itn completion: a script for the shell, made of the commands and flags that there are.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/output.h"
#include "common/flags.h"

namespace itn {
namespace {

constexpr const char* kBashScript = R"(# Completion of itn for bash: source <(itn completion bash)
_itn() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} command= word words=
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    [[ $word != -* ]] && {{ command=$word; break; }}
  done
  case $command in
    '') words="{}" ;;
{}  esac
  COMPREPLY=()
  [[ -z $command || $current == -* ]] && COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _itn itn
)";

std::string bash_script(const CLI::App& app) {
  std::vector<std::string> names;
  std::string cases;
  for (const CLI::App* command : app.get_subcommands({})) {
    names.push_back(command->get_name());
    std::vector<std::string> flags;
    for (const CLI::Option* option : command->get_options()) {
      for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
    }
    cases += fmt::format("    {}) words=\"{}\" ;;\n", command->get_name(), fmt::join(flags, " "));
  }
  return fmt::format(kBashScript, fmt::join(names, " "), cases);
}

}  // namespace

void add_completion_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "completion", "Print a script that completes commands and flags in a shell");
  const auto shell = std::make_shared<std::string>();
  command->add_option("shell", *shell, "bash")->required()->check(one_of({"bash"}));
  command->callback([shell, &app] { print_result(bash_script(app)); });
}

}  // namespace itn
