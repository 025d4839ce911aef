#include "server/render/render_server.h"

namespace itn {

RenderServer::RenderServer(const RenderServerOptions& options)
    : service_(options.service),
      server_({options.listen, options.reflection, options.service.limits.max_message_bytes},
              service_, v1::RenderService::service_full_name()) {}

void RenderServer::drain() {
  server_.stop_serving();
  service_.drain();
  server_.shut_down();
}

}  // namespace itn
