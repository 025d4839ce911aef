// The main function of a server program, once its flags are declared.
#pragma once

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>

#include "common/error.h"
#include "common/logging.h"
#include "common/rpc/shutdown_signal.h"

namespace itn {

// The flags that every server has.
inline void add_server_flags(CLI::App& app, const std::string& program, bool& reflection,
                             std::string& log_level) {
  app.add_flag("--reflection,!--no-reflection", reflection,
               "gRPC server reflection (on by default)");
  app.add_option("--log-level", log_level, "What to log on stderr")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  app.set_version_flag("--version", program + " " ITN_VERSION);
}

// Parses the flags, calls `start`, which returns a pointer to a server with address() and drain(),
// prints the address as one line on stdout, and waits for SIGTERM or SIGINT; then lets the server
// finish what is under way. Returns the exit code.
template <typename Start>
int server_main(CLI::App& app, const std::string& program, int argc, char** argv,
                const std::string& log_level, const Start& start) {
  ShutdownSignal signal;
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  try {
    set_up_logging(log_level);
    const auto server = start();
    std::printf("%s\n", server->address().c_str());
    std::fflush(stdout);
    spdlog::info("{} " ITN_VERSION " listens on {}", program, server->address());
    signal.wait();
    spdlog::info("stopping: finishing what is under way; a second signal stops at once");
    signal.exit_on_next();
    server->drain();
    spdlog::info("stopped");
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), error.what());
    return exit_code(error.kind());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), error.what());
    return exit_code(ErrorKind::kInternal);
  }
}

}  // namespace itn
