#include "common/rpc/grpc_server.h"

#include <fmt/format.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include "common/error.h"

namespace itn {
namespace {

using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

// gRPC's reflection library adds itself to every server of a process that is linked with it; this
// leaves it in or takes it out for one server.
class ReflectionOption final : public grpc::ServerBuilderOption {
 public:
  explicit ReflectionOption(bool enabled) : enabled_(enabled) {}

  void UpdateArguments(grpc::ChannelArguments* /*args*/) override {}

  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    grpc::reflection::ProtoServerReflectionPlugin reflection;
    std::erase_if(*plugins, [&](const auto& p) { return p->name() == reflection.name(); });
    if (enabled_) {
      plugins->push_back(std::make_unique<grpc::reflection::ProtoServerReflectionPlugin>());
    }
  }

 private:
  bool enabled_;
};

int in_ms(milliseconds duration) {
  return static_cast<int>(duration.count());
}

void set_connection_arguments(grpc::ServerBuilder& builder) {
  // A port that another process listens on is an error, not shared with it.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  // Clients may ping as often as they need to notice quickly that a worker hangs.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PING_STRIKES, 0);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  // Notices clients that have vanished, whose renders nobody waits for.
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, in_ms(seconds(20)));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, in_ms(seconds(10)));
  // Clients that find workers by name look the name up again when a connection ends, and so learn
  // of new workers. Calls under way are not cut.
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, in_ms(minutes(5)));
}

std::string with_port(const std::string& address, int port) {
  return fmt::format("{}:{}", address.substr(0, address.rfind(':')), port);
}

}  // namespace

GrpcServer::GrpcServer(const GrpcServerOptions& options, grpc::Service& service,
                       const std::string& name) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::ServerBuilder builder;
  set_connection_arguments(builder);
  const int max_message = static_cast<int>(
      std::min<uint64_t>(options.max_message_bytes, std::numeric_limits<int>::max()));
  builder.SetMaxReceiveMessageSize(max_message);
  builder.SetMaxSendMessageSize(max_message);
  builder.SetOption(std::make_unique<ReflectionOption>(options.reflection));
  builder.RegisterService(&service);
  int port = 0;
  if (!options.listen.empty()) {
    builder.AddListeningPort(options.listen, grpc::InsecureServerCredentials(), &port);
  }
  server_ = builder.BuildAndStart();
  if (!server_ || (!options.listen.empty() && port == 0)) {
    throw Error(ErrorKind::kIo,
                fmt::format("cannot listen on {}: not an address HOST:PORT of this machine, or in "
                            "use already",
                            options.listen));
  }
  if (port != 0) address_ = with_port(options.listen, port);
  server_->GetHealthCheckService()->SetServingStatus(name, true);
}

GrpcServer::~GrpcServer() {
  server_->Shutdown(std::chrono::system_clock::now());
}

std::shared_ptr<grpc::Channel> GrpcServer::in_process_channel() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);  // no limit
  arguments.SetMaxSendMessageSize(-1);
  return server_->InProcessChannel(arguments);
}

void GrpcServer::stop_serving() {
  server_->GetHealthCheckService()->Shutdown();
}

void GrpcServer::shut_down() {
  // Calls that never end by themselves, like a health watch, are cut after this time.
  server_->Shutdown(std::chrono::system_clock::now() + seconds(2));
}

}  // namespace itn
