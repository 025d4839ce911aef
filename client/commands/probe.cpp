// itn probe: asks a server whether it serves, for health checks of containers and clusters.
#include <fmt/format.h>
#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <chrono>
#include <future>
#include <memory>
#include <string>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/output.h"
#include "client/rpc/channel.h"
#include "client/rpc/deadline.h"
#include "common/error.h"
#include "common/flags.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

// grpc.health.v1.Health/Check without its .proto file, which no package carries for C++. On the
// wire, HealthCheckRequest {string service = 1} is a StringValue, and HealthCheckResponse
// {ServingStatus status = 1} a UInt32Value.
using HealthStub =
    grpc::TemplatedGenericStub<google::protobuf::StringValue, google::protobuf::UInt32Value>;
constexpr const char* kCheckMethod = "/grpc.health.v1.Health/Check";
constexpr uint32_t kServing = 1;

struct ProbeOptions {
  std::string address;
  std::string service;
  ClientSecurity security;
  double timeout = 3;  // in seconds
};

bool serves(const ProbeOptions& options) {
  const Connector connector(options.security);
  HealthStub stub(connector.connect_to(options.address));
  grpc::ClientContext context;
  context.set_deadline(deadline_in(std::chrono::duration<double>(options.timeout)));
  google::protobuf::StringValue request;
  request.set_value(options.service);
  google::protobuf::UInt32Value response;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, kCheckMethod, grpc::StubOptions(), &request, &response,
                 [&](grpc::Status status) { done.set_value(std::move(status)); });
  const grpc::Status status = connector.with_cause(done.get_future().get(), options.address);
  if (!status.ok()) {
    throw Error(ErrorKind::kUnavailable, fmt::format("{} does not serve{}{}: {}", options.address,
                                                     options.service.empty() ? "" : " ",
                                                     options.service, message_of(status)));
  }
  return response.value() == kServing;
}

void probe(const ProbeOptions& options) {
  const bool serving = serves(options);
  print_result("{}\n", serving ? "SERVING" : "NOT_SERVING");
  if (!serving) throw Error(ErrorKind::kUnavailable, options.address + " is not serving");
}

}  // namespace

void add_probe_command(CLI::App& app) {
  const auto options = std::make_shared<ProbeOptions>();
  CLI::App* command = app.add_subcommand(
      "probe", "Ask a worker or predictor for its health; exit code 0 if it serves, else 5");
  command->add_option("address", options->address, "HOST:PORT")->required()->check(kOneServer);
  command->add_option("--service", options->service,
                      "Full name of a service, e.g. itn.v1.RenderService; empty: the server");
  add_security_flags(*command, options->security);
  command->add_option("--timeout", options->timeout, "In seconds")
      ->check(number_in(0.01, 3600.0))
      ->capture_default_str();
  command->callback([options] { probe(*options); });
}

}  // namespace itn
