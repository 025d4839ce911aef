// Channels to workers and predictors: the one place that says how a connection is made, watched and
// secured.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/status.h>

#include <memory>
#include <string>

#include "client/rpc/client_security.h"

namespace itn {

// Makes channels, all secured in the same way. Files that have changed are read again: certificates
// within seconds, for connections made from then on, the token for the next call. Thread-safe.
class Connector {
 public:
  // Throws Error as read_certificates() and TokenFile; kUsage for a certificate or a name without
  // an authority.
  explicit Connector(ClientSecurity security = {});

  // To HOST:PORT, connected when first used; no other channel shares its connection. Messages have
  // no limit here: what a request or a reply may take is the server's to say. A server that hangs
  // without closing its connection is noticed within 4 s, and one that is started again is found
  // again within 2 s.
  //
  // A name that gRPC resolves, with its scheme ("dns:///workers:50051", "unix:/run/worker"), is
  // taken as it is. Throws Error (kUsage) that says what is wrong with anything else, and for a
  // token that would leave this machine without TLS.
  std::shared_ptr<grpc::Channel> connect_to(const std::string& address) const;

  // The status of a call to this address. Where it failed for want of a connection, it also says
  // how the client tried to make one, as gRPC hardly tells what the server disliked.
  grpc::Status with_cause(const grpc::Status& status, const std::string& address) const;

 private:
  ClientSecurity security_;
  std::shared_ptr<grpc::ChannelCredentials> credentials_, socket_credentials_;  // for unix:PATH
};

}  // namespace itn
