// Certificates of an authority of a test's own, made by deploy/make-test-ca.sh.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

#include "client/rpc/client_security.h"
#include "server/rpc/server_security.h"
#include "tests/support/paths.h"
#include "tests/support/temporary_folder.h"

namespace itn::testing {

class TestAuthority {
 public:
  // Whether there is what makes certificates.
  static bool is_possible() { return std::system("command -v openssl >/dev/null") == 0; }

  TestAuthority() { shell(testing::source("deploy/make-test-ca.sh") + " \"$PWD\""); }

  std::string path(const std::string& name) const { return folder_.path(name); }

  // For a server, and for a client that shows its certificate.
  ServerSecurity server() const {
    return {
        .files = {path("server.pem"), path("server.key"), ""}, .token_file = "", .insecure = false};
  }
  ServerSecurity server_of_known_clients() const {
    ServerSecurity security = server();
    security.files.authority = path("ca.pem");
    return security;
  }
  ClientSecurity client() const {
    return {.files = {path("client.pem"), path("client.key"), path("ca.pem")},
            .server_name = "",
            .token_file = ""};
  }
  ClientSecurity anonymous_client() const {
    ClientSecurity security = client();
    security.files.certificate = security.files.key = "";
    return security;
  }

  // The server's certificate as it will be after its last day.
  void let_server_expire() const { certify_server("IP:127.0.0.1", -1); }

  // Makes it for other names or addresses, e.g. "DNS:worker".
  void certify_server(const std::string& names, int days = 1) const {
    shell(
        "openssl req -new -key server.key -subj /CN=another -out another.csr 2>/dev/null &&"
        "echo subjectAltName=" +
        names +
        " >another.ext &&"
        "openssl x509 -req -in another.csr -CA ca.pem -CAkey ca.key -set_serial 7 -days " +
        std::to_string(days) + " -extfile another.ext -out server.pem 2>/dev/null");
  }

  // Runs in the folder of the certificates.
  void shell(const std::string& command) const {
    const std::string quiet =
        "cd '" + folder_.path().string() + "' && (" + command + ") >/dev/null";
    if (std::system(quiet.c_str()) != 0) throw std::runtime_error("failed: " + command);
  }

 private:
  TemporaryFolder folder_;
};

// Files that something may be reading are replaced: first the one, then the other.
inline void copy_over(const std::string& from, const std::string& to) {
  std::filesystem::copy_file(from, to, std::filesystem::copy_options::overwrite_existing);
}

}  // namespace itn::testing
