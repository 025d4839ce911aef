#include "common/rpc/client_identity.h"

#include <grpcpp/security/auth_context.h>

#include <memory>

namespace itn {

std::string host_of_peer(const std::string& peer) {
  const size_t colon = peer.rfind(':');
  const bool has_port = peer.starts_with("ipv4:") || peer.starts_with("ipv6:");
  return has_port ? peer.substr(0, colon) : peer;
}

QueueClient client_of(const grpc::CallbackServerContext& context) {
  const std::string connection = context.peer();
  const std::shared_ptr<const grpc::AuthContext> shown = context.auth_context();
  if (!shown || !shown->IsPeerAuthenticated()) return {host_of_peer(connection), connection};
  std::string who = "certificate";
  for (const grpc::string_ref& name : shown->GetPeerIdentity()) {
    who.append(" ").append(name.data(), name.size());
  }
  return {who, connection};
}

}  // namespace itn
