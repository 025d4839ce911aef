// itn: the command line. Exit codes are those of common/error.h.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "client/commands/command.h"
#include "client/interrupt.h"
#include "common/error.h"
#include "common/logging.h"
#include "common/rpc/grpc_server.h"

namespace itn {
namespace {

int run(int argc, char** argv) {
  watch_interrupts();
  CLI::App app("Optical parameters of a translucent material from a single photograph.");
  app.require_subcommand(0, 1);
  app.set_version_flag("--version", "itn " ITN_VERSION);
  add_render_command(app);
  add_shapes_command(app);
  add_probe_command(app);
  add_dataset_command(app);
  add_train_command(app);
  add_evaluate_command(app);
  add_predict_command(app);
  try {
    set_up_logging();
    log_libraries_through_spdlog();
    app.parse(argc, argv);
    if (!app.get_subcommands().empty()) return 0;
    std::fprintf(stderr, "%s", app.help().c_str());
    return exit_code(ErrorKind::kUsage);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : exit_code(ErrorKind::kUsage);
  } catch (const Error& error) {
    std::fprintf(stderr, "itn: %s\n", error.what());
    return exit_code(error.kind());
  }
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  try {
    return itn::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "itn: %s\n", error.what());
    return itn::exit_code(itn::ErrorKind::kInternal);
  }
}
