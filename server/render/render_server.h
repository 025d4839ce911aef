// A render worker: the render service with health service and reflection, behind a port, an
// in-process channel, or both.
//
// Connections are neither encrypted nor authenticated: for private networks only.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "common/rpc/grpc_server.h"
#include "server/render/render_service.h"

namespace itn {

struct RenderServerOptions {
  std::string listen;  // as in GrpcServerOptions
  bool reflection = true;
  // Of the process, resident; 0: no limit. Lowers the limits of the service to what fits
  // (plan_memory).
  uint64_t max_memory_bytes = 0;
  RenderServiceOptions service;
};

class RenderServer {
 public:
  // Throws Error (kUsage) if the address is none, kIo if it cannot listen.
  explicit RenderServer(const RenderServerOptions& options);
  // Stops what is under way and answers it UNAVAILABLE.
  ~RenderServer();

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return server_.address(); }

  // Renders that are worked on now; others wait.
  size_t running() const { return service_.running(); }

  std::shared_ptr<grpc::Channel> in_process_channel() { return server_.in_process_channel(); }

  // Reports NOT_SERVING and answers new requests UNAVAILABLE; returns when those accepted before
  // are answered, or `patience` later, when what is left is stopped and answered UNAVAILABLE, too.
  void drain(std::chrono::duration<double> patience);

 private:
  RenderService service_;
  GrpcServer server_;  // last: it calls the service
};

}  // namespace itn
