// What a client shows and wants of the servers that it connects to.
#pragma once

#include <string>

#include "common/rpc/certificates.h"

namespace itn {

// Throws Error (kUsage), which says what would be right, if Connector::connect_to would for an
// address that is none.
void check_address(const std::string& address);

struct ClientSecurity {
  // With an authority, connections are by TLS, to servers whose certificate is of that authority;
  // with a certificate, the client shows it to servers that ask for one.
  CertificateFiles files;
  // What the server's certificate calls it; empty: as its address does.
  std::string server_name;
  // If not empty, every call carries its (first) token.
  std::string token_file;

  bool encrypts() const { return !files.authority.empty(); }
  // It may not leave this machine then.
  bool is_token_alone() const { return !token_file.empty() && !encrypts(); }
};

}  // namespace itn
