// The main function of a server program, once its flags are declared.
#pragma once

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <optional>
#include <string>

#include "common/error.h"
#include "common/flags.h"
#include "common/logging.h"
#include "common/printable.h"
#include "common/rpc/host_port.h"
#include "common/rpc/library_log.h"
#include "common/rpc/shutdown_signal.h"
#include "common/suggestion.h"
#include "server/rpc/grpc_server.h"
#include "server/rpc/memory_plan.h"
#include "server/rpc/metrics.h"
#include "server/rpc/process_memory.h"
#include "server/rpc/queued_call.h"
#include "server/rpc/server_security.h"

namespace itn {

// The flags that every server has.
struct ServerFlags {
  uint64_t max_memory_mb = 0;  // 0: default_memory()
  double drain_seconds = 30;
  std::string log_level = "info";
  std::string log_format = "text";
  std::string metrics_file;  // empty: none
  double metrics_seconds = 15;

  uint64_t max_memory_bytes() const {
    return max_memory_mb == 0 ? default_memory() : max_memory_mb << 20;
  }
};

// An empty name, of a variable that was never set for instance, must not leave a server open.
inline const CLI::Validator kNamesAFile(
    [](const std::string& path) { return std::string(path.empty() ? "names no file" : ""); }, "",
    "");

inline void add_security_flags(CLI::App& app, ServerSecurity& security) {
  CLI::Option* const certificate = app.add_option(
      "--tls-cert", security.files.certificate,
      "PEM file of the certificate, with those between it and its authority's: connections are by "
      "TLS. It, its key and --tls-client-ca are read again when they have changed, for connections "
      "made from then on");
  CLI::Option* const key =
      app.add_option("--tls-key", security.files.key, "PEM file of the certificate's private key");
  certificate->check(kNamesAFile)->needs(key);
  key->check(kNamesAFile)->needs(certificate);
  app.add_option("--tls-client-ca", security.files.authority,
                 "PEM file of an authority's certificate: clients must show a certificate that "
                 "comes from it (mutual TLS)")
      ->check(kNamesAFile)
      ->needs(certificate);
  app.add_option("--token-file", security.token_file,
                 "File with a secret of 16 characters at least, or several, one a line: calls must "
                 "carry one of them. Read again when it has changed")
      ->check(kNamesAFile);
  app.add_flag("--insecure", security.insecure,
               "Listen on addresses that other machines reach without TLS, too: only where "
               "everybody who reaches them is trusted");
}

// `own_bytes`: of memory, for the program itself.
inline void add_server_flags(CLI::App& app, const std::string& program, uint64_t own_bytes,
                             GrpcServerOptions& server, ServerFlags& flags) {
  app.add_option("--listen", server.listen,
                 "HOST:PORT or [IPV6]:PORT to listen on; port 0 takes any that is free; 0.0.0.0 is "
                 "all IPv4 addresses, [::] all addresses. Addresses that other machines reach want "
                 "--tls-cert or --insecure. unix:PATH is a socket on this machine, for those whom "
                 "the permissions of its folder let in")
      ->check([](const std::string& address) {
        try {
          if (!socket_path(address)) parse_host_port(address, PortZero::kAnyFree);
          return std::string();
        } catch (const Error& error) {
          return std::string(error.what());
        }
      })
      ->capture_default_str();
  add_security_flags(app, server.security);
  app.add_option("--max-memory-mb", flags.max_memory_mb,
                 fmt::format("Most memory of this process, in MiB, {} at least; what does not fit "
                             "is refused. 0: 4096, or three quarters of what the machine or "
                             "container or service has, or half of ulimit -v",
                             least_memory(own_bytes) >> 20))
      ->check(number_in(0, 1 << 24))
      ->capture_default_str();
  app.add_option("--drain-seconds", flags.drain_seconds,
                 fmt::format("After SIGTERM, what is under way has this long to end; then it is "
                             "stopped and answered UNAVAILABLE. The process ends {} s later at "
                             "most, with exit code {} if it had to leave something unfinished",
                             kStopPatience.count(), exit_code(ErrorKind::kCancelled)))
      ->check(number_in(0.0, 86400.0))
      ->capture_default_str();
  app.add_option("--log-level", flags.log_level, "What to log on stderr")
      ->check(one_of({"debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  app.add_option("--log-format", flags.log_format,
                 "Lines for people, or one JSON object a line, with time (UTC), level and message")
      ->check(one_of({"text", "json"}))
      ->capture_default_str();
  const auto metrics = app.add_option("--metrics-file", flags.metrics_file,
                                      "Write counts of calls, their times and memory there, for "
                                      "Prometheus (node_exporter's textfile collector reads "
                                      "*.prom files of a folder)");
  app.add_option("--metrics-seconds", flags.metrics_seconds, "How often, in seconds")
      ->check(number_in(1.0, 86400.0))
      ->needs(metrics)
      ->capture_default_str();
  app.set_version_flag("--version", program + " " ITN_VERSION);
}

// Parses the flags, calls `start`, which returns a pointer to a server with address(), metrics()
// and drain(), prints the address as one line on stdout, and waits for SIGTERM or SIGINT; then lets
// the server finish what is under way. Returns the exit code; if something does not stop, ends the
// process with that of an interruption.
template <typename Start>
int server_main(CLI::App& app, const std::string& program, int argc, char** argv,
                const ServerFlags& flags, const Start& start) {
  return_freed_memory();
  ShutdownSignal signal;
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    const std::string unknown = unknown_flag(app, program, {argv + 1, argv + argc});
    std::fprintf(stderr, "%s: %s\nRun with --help for more information.\n", program.c_str(),
                 (unknown.empty() ? message_of(error) : unknown).c_str());
    return exit_code(ErrorKind::kUsage);
  }
  try {
    set_up_logging(flags.log_level,
                   flags.log_format == "json" ? LogFormat::kJson : LogFormat::kText);
    log_libraries_through_spdlog();
    if (!flags.metrics_file.empty()) check_metrics_file(flags.metrics_file);
    const auto server = start();
    std::optional<MetricsFile> metrics;
    if (!flags.metrics_file.empty()) {
      metrics.emplace(flags.metrics_file, server->address(),
                      std::chrono::duration<double>(flags.metrics_seconds),
                      [&] { return server->metrics(); });
    }
    std::printf("%s\n", server->address().c_str());
    std::fflush(stdout);
    spdlog::info("{} " ITN_VERSION " listens on {}, takes at most {} MiB of memory", program,
                 server->address(), flags.max_memory_bytes() >> 20);
    signal.wait();
    spdlog::info(
        "stopping: finishing what is under way, within {:g} s; a second signal stops at once",
        flags.drain_seconds);
    signal.exit_on_next();
    if (!server->drain(std::chrono::duration<double>(flags.drain_seconds))) {
      // Its threads cannot be joined, and nothing that they still do is of use to anybody.
      spdlog::error("what is under way does not stop: the process ends without it");
      _exit(exit_code(ErrorKind::kCancelled));
    }
    spdlog::info("stopped");
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), for_terminal(error.what()).c_str());
    return exit_code(error.kind());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), for_terminal(error.what()).c_str());
    return exit_code(ErrorKind::kInternal);
  }
}

}  // namespace itn
