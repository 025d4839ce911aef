// itn top: how workers and predictors are doing.
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/pause.h"
#include "client/render_pool/worker_list.h"
#include "common/error.h"
#include "common/flags.h"
#include "common/logging.h"
#include "common/printable.h"
#include "common/rpc/channel.h"
#include "common/rpc/deadline.h"
#include "common/rpc/status.h"
#include "itn/v1/status.grpc.pb.h"

namespace itn {
namespace {

using std::chrono::milliseconds;

struct TopOptions {
  std::vector<std::string> servers;
  ClientSecurity security;
  double interval = 2;  // in seconds
  double timeout = 3;   // likewise
  bool once = false;
  bool json = false;
};

// What a server says, or why it does not.
struct Answer {
  std::string address;
  std::optional<v1::ServerStatus> status;
  std::string failure;
};

class Server {
 public:
  Server(const Connector& connector, std::string address, double timeout)
      : connector_(connector),
        address_(std::move(address)),
        timeout_(static_cast<int64_t>(timeout * 1000)),
        stub_(v1::StatusService::NewStub(connector.connect_to(address_))) {}

  Answer ask() const {
    Answer answer{.address = address_, .status = {}, .failure = {}};
    grpc::ClientContext context;
    context.set_deadline(deadline_in(timeout_));
    v1::ServerStatus status;
    const grpc::Status outcome =
        connector_.explained(stub_->GetStatus(&context, {}, &status), address_);
    if (outcome.ok()) {
      answer.status = std::move(status);
    } else {
      answer.failure = outcome.error_code() == grpc::StatusCode::UNIMPLEMENTED
                           ? "it is neither itn-worker nor itn-predictor of this version"
                           : message_of(outcome);
    }
    return answer;
  }

 private:
  const Connector& connector_;
  std::string address_;
  milliseconds timeout_;
  std::unique_ptr<v1::StatusService::Stub> stub_;
};

// A time in three digits.
std::string short_time(double seconds) {
  if (seconds == 0) return "-";
  if (seconds < 0.1) return fmt::format("{:.1f}ms", 1e3 * seconds);
  return seconds < 1 ? fmt::format("{:.0f}ms", 1e3 * seconds) : fmt::format("{:.1f}s", seconds);
}

std::string short_number(double number) {
  if (number >= 1e6) return fmt::format("{:.1f}M", number / 1e6);
  if (number >= 1e4) return fmt::format("{:.0f}k", number / 1e3);
  return fmt::format("{:.{}f}", number, number < 10 ? 1 : 0);
}

std::string short_count(uint64_t count) {
  return count < 10'000 ? fmt::format("{}", count) : short_number(static_cast<double>(count));
}

// `width`: of the first column, as wide as the longest address.
std::string row(size_t width, const std::vector<std::string>& cells) {
  return fmt::format("{:<{}}{:<12}{:>9}{:>9}{:>9}{:>9}{:>8}{:>9}{:>9}{:>9}{:>9}{:>14}{:>9}\n",
                     cells[0], width, cells[1], cells[2], cells[3], cells[4], cells[5], cells[6],
                     cells[7], cells[8], cells[9], cells[10], cells[11], cells[12]);
}

std::string header(size_t width) {
  return row(width, {"server", "call", "running", "waiting", "OK", "failed", "1/s", "wait p50",
                     "p99", "work p50", "p99", "done/s", "MiB"});
}

std::string rows_of(const v1::ServerStatus& status, const std::string& name, size_t width) {
  const std::string running = fmt::format("{}/{}", status.running(), status.most_running());
  const std::string waiting = fmt::format("{}/{}", status.waiting(), status.most_waiting());
  const std::string memory = fmt::format("{}", status.resident_bytes() >> 20);
  if (status.methods().empty()) {
    return row(width, {name, status.draining() ? "draining" : "-", running, waiting, "0", "0", "-",
                       "-", "-", "-", "-", "-", memory});
  }
  std::string text;
  for (const v1::MethodStatus& method : status.methods()) {
    uint64_t ok = 0, failed = 0;
    for (const v1::AnswerCount& answers : method.answers()) {
      // Whoever is asked to send the scene comes again with it.
      if (answers.status() == "FAILED_PRECONDITION") continue;
      (answers.status() == "OK" ? ok : failed) += answers.count();
    }
    text += row(width,
                {text.empty() ? name : "", printable(method.method(), 11), running, waiting,
                 short_count(ok), short_count(failed), short_number(method.lately_per_second()),
                 short_time(method.lately_queue().p50()), short_time(method.lately_queue().p99()),
                 short_time(method.lately_work().p50()), short_time(method.lately_work().p99()),
                 short_number(method.lately_units_per_second()) + " " + printable(method.unit(), 8),
                 memory});
  }
  return text;
}

std::string table_of(const std::vector<Answer>& answers) {
  size_t width = std::string_view("server  ").size();
  for (const Answer& answer : answers) {
    width = std::max(width, printable(answer.address).size() + 2);
  }
  std::string text = header(width);
  for (const Answer& answer : answers) {
    const std::string name = printable(answer.address);
    text += answer.status ? rows_of(*answer.status, name, width)
                          : fmt::format("{:<{}}{}\n", name, width, printable(answer.failure, 300));
  }
  return text;
}

// One line for each server.
std::string json_of(const std::vector<Answer>& answers) {
  std::string text;
  for (const Answer& answer : answers) {
    text += fmt::format("{{\"address\":\"{}\",{}}}\n", json_escaped(answer.address),
                        answer.status
                            ? "\"status\":" + to_json(*answer.status)
                            : fmt::format("\"failure\":\"{}\"", json_escaped(answer.failure)));
  }
  return text;
}

// Those that the command line names, as names and files on it say now.
class Servers {
 public:
  explicit Servers(const TopOptions& options) : options_(options), list_(options.servers) {}

  // All at once.
  std::vector<Answer> ask() {
    std::map<std::string, std::unique_ptr<Server>> known = std::move(servers_);
    servers_.clear();
    std::vector<std::future<Answer>> asked;
    for (const auto& [address, name] : list_.ask(interruption())) {
      std::unique_ptr<Server>& server = servers_[address];
      server = std::move(known[address]);
      if (!server) {
        server = std::make_unique<Server>(connector_to(name), address, options_.timeout);
      }
      asked.push_back(std::async(std::launch::async, [&server] { return server->ask(); }));
    }
    std::vector<Answer> answers;
    answers.reserve(asked.size());
    for (auto& answer : asked) answers.push_back(answer.get());
    return answers;
  }

  // What names and files have to say.
  std::string awaited() const { return list_.awaited(); }

 private:
  // To servers that were found by this name, which their certificates say then.
  const Connector& connector_to(const std::string& name) {
    std::unique_ptr<Connector>& connector = connectors_[name];
    if (!connector) {
      ClientSecurity security = options_.security;
      if (security.encrypts() && security.server_name.empty()) security.server_name = name;
      connector = std::make_unique<Connector>(security);
    }
    return *connector;
  }

  const TopOptions& options_;
  WorkerList list_;
  std::map<std::string, std::unique_ptr<Connector>> connectors_;
  std::map<std::string, std::unique_ptr<Server>> servers_;  // by address
};

void top(const TopOptions& options) {
  Servers servers(options);
  const bool clears = !options.once && !options.json && ::isatty(STDOUT_FILENO) != 0;
  while (true) {
    const std::vector<Answer> answers = servers.ask();
    if (clears) std::fputs("\x1b[H\x1b[2J", stdout);
    print_result(options.json ? json_of(answers) : table_of(answers));
    std::fflush(stdout);
    if (answers.empty()) spdlog::warn("there is no server: {}", servers.awaited());
    if (options.once) {
      for (const Answer& answer : answers) {
        if (answer.status) return;
      }
      throw Error(ErrorKind::kUnavailable, "no server answers");
    }
    if (interrupted_within(std::chrono::duration<double>(options.interval))) return;
  }
}

}  // namespace

void add_top_command(CLI::App& app) {
  const auto options = std::make_shared<TopOptions>();
  CLI::App* command = app.add_subcommand(
      "top", "What workers and predictors are at: calls, times until and of their work, memory");
  command
      ->add_option("servers", options->servers,
                   "HOST:PORT, dns:///NAME:PORT or file:PATH, as of --workers, separated by commas "
                   "or spaces")
      ->required()
      ->delimiter(',');
  add_security_flags(*command, options->security);
  command->add_option("--interval", options->interval, "From one look to the next, in seconds")
      ->check(number_in(0.1, 86400.0))
      ->capture_default_str();
  command->add_option("--timeout", options->timeout, "Of a look, in seconds")
      ->check(number_in(0.01, 3600.0))
      ->capture_default_str();
  command->add_flag("--once", options->once, "One look; exit code 5 if none of them answers");
  command->add_flag("--json", options->json,
                    "A line for each server: ServerStatus of itn/v1/status.proto");
  command->callback([options] { top(*options); });
}

}  // namespace itn
