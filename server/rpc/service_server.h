// A service of ours with its server and health service: what all server programs are.
#pragma once

#include <grpcpp/channel.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "server/rpc/grpc_server.h"
#include "server/rpc/metrics.h"
#include "server/rpc/process_memory.h"

namespace itn {

// A Service answers its calls at a CallScheduler: it has full_name(), describe() and
// drain().
template <typename Service>
class ServiceServer {
 public:
  // The arguments after the first are those of the service. Throws Error (kUsage) if the address is
  // none, kIo if it cannot listen.
  template <typename... Arguments>
  explicit ServiceServer(const GrpcServerOptions& options, Arguments&&... arguments)
      : service_(std::forward<Arguments>(arguments)...),
        max_resident_bytes_(options.max_memory_bytes),
        server_(options, service_, Service::full_name()) {}
  // Stops what is under way and answers it UNAVAILABLE.
  ~ServiceServer() { service_.drain(std::chrono::seconds(0)); }
  ServiceServer(const ServiceServer&) = delete;
  ServiceServer& operator=(const ServiceServer&) = delete;

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return server_.address(); }

  ServerMetrics metrics() const {
    ServerMetrics metrics;
    metrics.service = Service::full_name();
    metrics.uptime_seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    metrics.draining = draining_;
    metrics.resident_bytes = resident_memory();
    metrics.max_resident_bytes = max_resident_bytes_;
    metrics.allocated_bytes = allocated_memory();
    service_.describe(metrics);
    server_.describe(metrics);
    return metrics;
  }

  std::shared_ptr<grpc::Channel> in_process_channel() { return server_.in_process_channel(); }

  // Reports NOT_SERVING and answers new requests UNAVAILABLE; returns when those accepted before
  // are answered, or `patience` later, when what is left is stopped and answered UNAVAILABLE, too.
  // False if something does not stop (see CallScheduler::drain).
  bool drain(std::chrono::duration<double> patience) {
    draining_ = true;
    server_.stop_serving();
    const bool stopped = service_.drain(patience);
    server_.close_connections();
    return stopped;
  }

 protected:
  const Service& service() const { return service_; }

 private:
  Service service_;
  const uint64_t max_resident_bytes_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::atomic<bool> draining_ = false;
  GrpcServer server_;  // last: it calls the service
};

}  // namespace itn
