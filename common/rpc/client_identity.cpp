#include "common/rpc/client_identity.h"

#include <grpcpp/security/auth_context.h>
#include <grpcpp/server_context.h>

#include <memory>

#include "common/rpc/host_port.h"

namespace itn {

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
