// A gRPC server for one service of ours, with gRPC's health service, behind a port, an
// in-process channel, or both.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <cstdint>
#include <memory>
#include <string>

#include "server/rpc/listener.h"
#include "server/rpc/metrics.h"
#include "server/rpc/server_security.h"

namespace itn {

struct GrpcServerOptions {
  // HOST:PORT or [IPV6]:PORT; port 0 takes any that is free. Empty: only in_process_channel() leads
  // here.
  std::string listen;
  ServerSecurity security;                            // of connections to that address
  uint64_t max_message_bytes = uint64_t{2047} << 20;  // of a request and of a reply
  // What gRPC may hold of messages that arrive; beyond it, it stops reading and closes connections.
  // 0: no limit.
  uint64_t transport_bytes = 0;
  uint64_t max_memory_bytes = 0;  // of the process, resident (see ListenerOptions); 0: no limit
};

// The same options with the limits of messages that plan_memory() leaves a process of
// `max_memory_bytes`; unchanged if that is 0. Throws as plan_memory().
GrpcServerOptions within_memory(GrpcServerOptions options, uint64_t own_bytes);

class GrpcServer {
 public:
  // `name` is the full name of the service. Health checks of it, and of "", tell whether the server
  // runs and is not about to stop. Throws Error: kUsage if `listen` is no address, or one that
  // other machines reach although connections are not encrypted and `security.insecure` is not set;
  // kIo if it cannot listen; as make_credentials().
  GrpcServer(const GrpcServerOptions& options, grpc::Service& service, const std::string& name);
  // Cancels what is under way.
  ~GrpcServer();
  GrpcServer(const GrpcServer&) = delete;
  GrpcServer& operator=(const GrpcServer&) = delete;

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return address_; }

  std::shared_ptr<grpc::Channel> in_process_channel();

  // Sets what it knows: its connections.
  void describe(ServerMetrics& metrics) const;

  // Health checks are answered NOT_SERVING from now on.
  void stop_serving();

  // After the service has answered what it had accepted. Ends all connections, so that calls that
  // come now fail as UNAVAILABLE; gRPC's own way of shutting down answers them CANCELLED.
  void close_connections();

 private:
  std::string address_;
  std::shared_ptr<grpc::ServerCredentials> credentials_;
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor_;
  std::unique_ptr<Listener> listener_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace itn
