// Who calls, as far as a server can tell.
#pragma once

#include <grpcpp/server_context.h>

#include <string>

#include "common/rpc/job_queue.h"

namespace itn {

// Who showed a certificate is who it names, however many machines and connections they call from;
// others are their machine. A token, which clients share, tells nobody apart.
QueueClient client_of(const grpc::CallbackServerContext& context);

// Of a peer as gRPC calls it, "ipv4:10.0.0.1:50123": without the port, which each connection has of
// its own.
std::string host_of_peer(const std::string& peer);

}  // namespace itn
