// itn relay: asks workers for a program that has no gRPC, such as a Python that renders.
#include <unistd.h>

#include <cstdlib>
#include <memory>
#include <stop_token>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/interrupt.h"
#include "client/render/relay.h"
#include "client/render_pool/render_pool.h"

namespace itn {
namespace {

void relay(const WorkerFlags& flags) {
  // It waits for its input, and has nothing to lose.
  const std::stop_callback at_interrupt(interruption(),
                                        [] { std::_Exit(exit_code(ErrorKind::kCancelled)); });
  RenderPool pool(flags.pool_options());
  relay_renders(pool, ITN_VERSION, STDIN_FILENO, STDOUT_FILENO);
}

}  // namespace

void add_relay_command(CLI::App& app) {
  const auto flags = std::make_shared<WorkerFlags>();
  CLI::App* command = app.add_subcommand(
      "relay",
      "Pass renders on for a program that has no gRPC: reads RenderGradRequests from standard "
      "input, writes RelayReplies to standard output (docs/reference/relay.md)");
  add_worker_flags(*command, *flags);
  command->callback([flags] { relay(*flags); });
}

}  // namespace itn
