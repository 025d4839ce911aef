// A gRPC server for one service of ours, with health service and reflection, behind a port, an
// in-process channel, or both.
//
// Connections are neither encrypted nor authenticated: for private networks only.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server.h>

#include <cstdint>
#include <memory>
#include <string>

namespace itn {

struct GrpcServerOptions {
  // HOST:PORT; port 0 takes any that is free. Empty: only in_process_channel() leads here.
  std::string listen;
  bool reflection = true;
  uint64_t max_message_bytes = uint64_t{2047} << 20;  // of a request and of a reply
};

class GrpcServer {
 public:
  // `name` is the full name of the service, which health checks ask for. Throws Error (kIo) if it
  // cannot listen.
  GrpcServer(const GrpcServerOptions& options, grpc::Service& service, const std::string& name);
  // Cancels what is under way.
  ~GrpcServer();
  GrpcServer(const GrpcServer&) = delete;
  GrpcServer& operator=(const GrpcServer&) = delete;

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return address_; }

  std::shared_ptr<grpc::Channel> in_process_channel();

  // Health checks are answered NOT_SERVING from now on.
  void stop_serving();

  // After the service has answered what it had accepted: leaves the last replies time to go out.
  void shut_down();

 private:
  std::string address_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace itn
