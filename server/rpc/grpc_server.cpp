#include "server/rpc/grpc_server.h"

#include <fmt/format.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include "common/error.h"
#include "server/rpc/memory_plan.h"

namespace itn {
namespace {

using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

// The most calls of one connection: more calls wait at the client.
constexpr int kMaxStreams = 256;
constexpr int kMaxHeaderBytes = 16 << 10;
// At a time: gRPC begins every call in what it has read before it notices that the connection was
// closed, and a call of a hundred bytes takes eight thousand.
constexpr int kMaxReadBytes = 64 << 10;

int in_ms(milliseconds duration) {
  return static_cast<int>(duration.count());
}

void set_connection_arguments(grpc::ServerBuilder& builder) {
  // A port that another process listens on is an error, not shared with it.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  // Clients may ping as often as they need to notice quickly that a worker hangs.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PING_STRIKES, 0);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  // What connects and does not begin to speak, by TLS or HTTP/2, is closed.
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, in_ms(seconds(10)));
  // Notices clients that have vanished, whose renders nobody waits for.
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, in_ms(seconds(20)));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, in_ms(seconds(10)));
  // Clients that find workers by name look the name up again when a connection ends, and so learn
  // of new workers; and certificates are looked at again. Calls under way are not cut.
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, in_ms(minutes(5)));
}

// A request is what its bytes say it is: half a megabyte of gzip can be six hundred.
void refuse_compression(grpc::ServerBuilder& builder) {
  for (const auto algorithm : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP}) {
    builder.SetCompressionAlgorithmSupportStatus(algorithm, false);
  }
  builder.AddChannelArgument(GRPC_ARG_ENABLE_PER_MESSAGE_DECOMPRESSION, 0);
}

void set_limits(grpc::ServerBuilder& builder, const GrpcServerOptions& options) {
  const int max_message = static_cast<int>(
      std::min<uint64_t>(options.max_message_bytes, std::numeric_limits<int>::max()));
  builder.SetMaxReceiveMessageSize(max_message);
  builder.SetMaxSendMessageSize(max_message);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kMaxStreams);
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, kMaxHeaderBytes);
  builder.AddChannelArgument(GRPC_ARG_TCP_MAX_READ_CHUNK_SIZE, kMaxReadBytes);
  if (options.transport_bytes > 0) {
    grpc::ResourceQuota quota("itn");
    quota.Resize(options.transport_bytes);
    builder.SetResourceQuota(quota);
  }
}

}  // namespace

GrpcServerOptions within_memory(GrpcServerOptions options, uint64_t own_bytes) {
  if (options.max_memory_bytes == 0) return options;
  const MemoryPlan plan =
      plan_memory(options.max_memory_bytes, own_bytes, options.max_message_bytes);
  options.max_message_bytes = plan.message_bytes;
  options.transport_bytes = plan.transport_bytes;
  return options;
}

GrpcServer::GrpcServer(const GrpcServerOptions& options, grpc::Service& service,
                       const std::string& name) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::ServerBuilder builder;
  set_connection_arguments(builder);
  set_limits(builder, options);
  refuse_compression(builder);
  builder.RegisterService(&service);
  if (!options.listen.empty()) {
    credentials_ = make_credentials(options.security);
    const bool open = options.security.encrypts() || options.security.insecure;
    listener_ = std::make_unique<Listener>(
        options.listen,
        ListenerOptions{.max_memory_bytes = options.max_memory_bytes, .this_machine_only = !open});
    address_ = listener_->address();
    acceptor_ = builder.experimental().AddExternalConnectionAcceptor(
        grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD, credentials_);
  }
  server_ = builder.BuildAndStart();
  if (!server_) throw Error(ErrorKind::kInternal, "gRPC cannot start a server");
  server_->GetHealthCheckService()->SetServingStatus(name, true);
  if (listener_) {
    listener_->start([this](int fd) {
      grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters connection;
      connection.fd = fd;
      acceptor_->HandleNewConnection(&connection);
    });
  }
}

GrpcServer::~GrpcServer() {
  close_connections();
  server_->Shutdown(std::chrono::system_clock::now());
}

std::shared_ptr<grpc::Channel> GrpcServer::in_process_channel() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);  // no limit
  arguments.SetMaxSendMessageSize(-1);
  return server_->InProcessChannel(arguments);
}

void GrpcServer::describe(ServerMetrics& metrics) const {
  if (!listener_) return;
  metrics.connections = listener_->connections();
  metrics.max_connections = listener_->max_connections();
}

void GrpcServer::stop_serving() {
  server_->GetHealthCheckService()->Shutdown();
}

void GrpcServer::close_connections() {
  if (listener_) listener_->close();
}

}  // namespace itn
