// A render worker: the render service with health service and reflection, behind a port, an
// in-process channel, or both.
//
// Connections are neither encrypted nor authenticated: for private networks only.
#pragma once

#include <memory>
#include <string>

#include "common/rpc/grpc_server.h"
#include "server/render/render_service.h"

namespace itn {

struct RenderServerOptions {
  // HOST:PORT; port 0 takes any that is free. Empty: only in_process_channel() leads here.
  std::string listen;
  bool reflection = true;
  RenderServiceOptions service;
};

class RenderServer {
 public:
  // Throws Error (kIo) if it cannot listen.
  explicit RenderServer(const RenderServerOptions& options);

  // HOST:PORT, with the port that was taken.
  const std::string& address() const { return server_.address(); }

  std::shared_ptr<grpc::Channel> in_process_channel() { return server_.in_process_channel(); }

  // Reports NOT_SERVING, answers new requests UNAVAILABLE, returns when those accepted before are
  // answered. Without it, the destructor cancels what is under way.
  void drain();

 private:
  RenderService service_;
  GrpcServer server_;  // last: it calls the service
};

}  // namespace itn
