// What a server demands of its connections and calls: TLS, clients' certificates, a token.
#pragma once

#include <memory>
#include <string>

#include "common/rpc/certificates.h"

namespace grpc {
class ServerCredentials;
}

namespace itn {

struct ServerSecurity {
  // With a certificate, connections are by TLS, 1.2 at least; with an authority, clients must show
  // a certificate of it.
  CertificateFiles files;
  // If not empty, calls must carry one of its tokens, but for health checks, which tell nothing.
  std::string token_file;
  // Without TLS: whether to listen on addresses that other machines reach.
  bool insecure = false;

  bool encrypts() const { return !files.certificate.empty(); }
};

// Must outlive the server. Files that have changed are read again for the next connection (the
// token's, for the next call); what cannot be used then is logged, and the former stay in use.
// Calls without a right token are answered UNAUTHENTICATED before their message is read. Throws
// Error as read_certificates() and TokenFile.
std::shared_ptr<grpc::ServerCredentials> make_credentials(const ServerSecurity& security);

}  // namespace itn
