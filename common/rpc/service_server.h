// A service of ours with its server, health service and reflection: what all server programs are.
#pragma once

#include <grpcpp/channel.h>

#include <chrono>
#include <memory>
#include <string>
#include <utility>

#include "common/rpc/grpc_server.h"
#include "common/rpc/status_service.h"

namespace itn {

// A Service answers its calls at a CallDesk: it has full_name(), can_take_work(), describe() and
// drain(). Beside it is a StatusService.
template <typename Service>
class ServiceServer {
 public:
  // The arguments after the first are those of the service. Throws Error (kUsage) if the address is
  // none, kIo if it cannot listen.
  template <typename... Arguments>
  explicit ServiceServer(const GrpcServerOptions& options, Arguments&&... arguments)
      : service_(std::forward<Arguments>(arguments)...),
        status_(
            Service::full_name(),
            [this](v1::ServerStatus& status) {
              service_.describe(status);
              server_.describe(status);
            },
            options.process_bytes),
        server_(options, service_, Service::full_name(),
                [this] { return service_.can_take_work(); }, {&status_}) {}
  // Stops what is under way and answers it UNAVAILABLE.
  ~ServiceServer() { service_.drain(std::chrono::seconds(0)); }
  ServiceServer(const ServiceServer&) = delete;
  ServiceServer& operator=(const ServiceServer&) = delete;

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return server_.address(); }

  v1::ServerStatus status() const { return status_.status(); }

  std::shared_ptr<grpc::Channel> in_process_channel() { return server_.in_process_channel(); }

  // Reports NOT_SERVING and answers new requests UNAVAILABLE; returns when those accepted before
  // are answered, or `patience` later, when what is left is stopped and answered UNAVAILABLE, too.
  // False if something does not stop (see CallDesk::drain).
  bool drain(std::chrono::duration<double> patience) {
    status_.set_draining();
    server_.stop_serving();
    const bool stopped = service_.drain(patience);
    server_.close_connections();
    return stopped;
  }

 protected:
  const Service& service() const { return service_; }

 private:
  Service service_;
  StatusService status_;
  GrpcServer server_;  // last: it calls the service
};

}  // namespace itn
