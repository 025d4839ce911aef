// Channels to workers and predictors: the one place that says how a connection is made, watched and
// secured.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

namespace itn {

// Throws Error (kUsage), which says what would be right, if `connect_to` would.
void check_address(const std::string& address);

// To HOST:PORT, connected when first used; no other channel shares its connection. Messages have no
// limit here: what a request or a reply may take is the server's to say. A server that hangs
// without closing its connection is noticed within 4 s, and one that is started again is found
// again within 2 s.
//
// A name that gRPC resolves, with its scheme ("dns:///workers:50051", "unix:/run/worker"), is taken
// as it is. Throws Error (kUsage) that says what is wrong with anything else.
//
// Neither encrypted nor authenticated: private networks only.
std::shared_ptr<grpc::Channel> connect_to(const std::string& address);

}  // namespace itn
