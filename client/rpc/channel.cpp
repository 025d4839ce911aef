#include "client/rpc/channel.h"

#include <fmt/format.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <cstdlib>
#include <map>
#include <optional>
#include <utility>

#include "common/error.h"
#include "common/printable.h"
#include "common/rpc/host_port.h"
#include "common/rpc/token_file.h"

namespace itn {
namespace {

// How soon certificates that were replaced are seen.
constexpr unsigned int kLookAtFilesEverySeconds = 5;

}  // namespace

// gRPC itself takes what has no port for one of port 443.
void check_address(const std::string& address) {
  if (!has_scheme(address)) parse_host_port(address);
  socket_path(address);
}

namespace {

bool is_this_machine(const std::string& address) {
  if (socket_path(address)) return true;
  const std::optional<HostPort> endpoint = endpoint_of_target(address);
  return endpoint && endpoint->is_loopback();
}

// The variable that names a proxy, if one does: gRPC looks at these, in this order.
const char* proxy_variable() {
  for (const char* const name : {"grpc_proxy", "https_proxy", "http_proxy"}) {
    const char* const value = std::getenv(name);
    if (value != nullptr && *value != '\0') return name;
  }
  return nullptr;
}

void check_flags(const ClientSecurity& security) {
  if (security.encrypts()) return;
  const auto useless = [](const char* flag) {
    return Error(ErrorKind::kUsage,
                 fmt::format("{} is of no use without --tls-ca, the certificate of the authority "
                             "that the server's certificate comes from",
                             flag));
  };
  if (!security.files.certificate.empty()) throw useless("--tls-cert");
  if (!security.server_name.empty()) throw useless("--tls-server-name");
}

class TokenPlugin final : public grpc::MetadataCredentialsPlugin {
 public:
  explicit TokenPlugin(const std::string& path) : tokens_(path) {}

  bool IsBlocking() const override { return false; }

  grpc::Status GetMetadata(grpc::string_ref /*service_url*/, grpc::string_ref /*method_name*/,
                           const grpc::AuthContext& /*context*/,
                           std::multimap<std::string, std::string>* metadata) override {
    metadata->emplace("authorization", tokens_.header());
    return grpc::Status::OK;
  }

  grpc::string DebugString() override { return "a token"; }

 private:
  TokenFile tokens_;
};

std::shared_ptr<grpc::ChannelCredentials> tls_credentials(const CertificateFiles& files) {
  grpc::experimental::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(
      std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
          files.key, files.certificate, files.authority, kLookAtFilesEverySeconds));
  options.watch_root_certs();
  if (!files.certificate.empty()) options.watch_identity_key_cert_pairs();
  return grpc::experimental::TlsCredentials(options);
}

std::shared_ptr<grpc::ChannelCredentials> make_credentials(const ClientSecurity& security,
                                                           grpc_local_connect_type local) {
  check_flags(security);
  read_certificates(security.files, Side::kClient);
  const bool token = !security.token_file.empty();
  if (!security.encrypts() && !token) return grpc::InsecureChannelCredentials();
  // gRPC lets a token go over TLS, or over what does not leave the machine, which it checks.
  auto channel = security.encrypts() ? tls_credentials(security.files)
                                     : grpc::experimental::LocalCredentials(local);
  if (!token) return channel;
  return grpc::CompositeChannelCredentials(
      channel, grpc::experimental::MetadataCredentialsFromPlugin(
                   std::make_unique<TokenPlugin>(security.token_file),
                   security.encrypts() ? GRPC_PRIVACY_AND_INTEGRITY : GRPC_SECURITY_NONE));
}

}  // namespace

Connector::Connector(ClientSecurity security)
    : security_(std::move(security)),
      credentials_(make_credentials(security_, LOCAL_TCP)),
      socket_credentials_(security_.is_token_alone() ? make_credentials(security_, UDS)
                                                     : credentials_) {}

std::shared_ptr<grpc::Channel> Connector::connect_to(const std::string& address) const {
  check_address(address);
  if (security_.is_token_alone() && !is_this_machine(address)) {
    throw Error(ErrorKind::kUsage,
                fmt::format("the token would go to {} unencrypted, for anybody to read on its way: "
                            "give --tls-ca, too",
                            printable(address)));
  }
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  arguments.SetMaxSendMessageSize(-1);
  // Longer than a busy machine may stall: a connection that is really lost is mostly closed, and
  // renders that are late are begun elsewhere long before.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 2000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 8000);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  // gRPC's default is 120 s.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 200);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 1000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // No proxy leads to this machine.
  if (is_this_machine(address)) arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  if (!security_.server_name.empty()) arguments.SetSslTargetNameOverride(security_.server_name);
  return grpc::CreateCustomChannel(
      address, socket_path(address) ? socket_credentials_ : credentials_, arguments);
}

grpc::Status Connector::with_cause(const grpc::Status& status, const std::string& address) const {
  // A server of ours that is unavailable says why, in details.
  const std::optional<HostPort> place = endpoint_of_target(address);
  if (status.error_code() != grpc::StatusCode::UNAVAILABLE || !status.error_details().empty() ||
      !place) {
    return status;
  }
  std::string message = status.error_message();
  if (const char* const proxy = proxy_variable(); proxy != nullptr && !place->is_loopback()) {
    message += fmt::format(
        ". The environment's {} names a proxy, through which connections go but for hosts in "
        "no_proxy: no_proxy={} goes straight there",
        proxy, place->host);
  }
  if (status.error_message().find("refused") == std::string::npos) {
    const auto& [files, server_name, token] = security_;
    std::string hint = "if the server encrypts its connections, give --tls-ca";
    if (security_.encrypts()) {
      hint = fmt::format(
          "its certificate must be of the authority in {} (--tls-ca), for {} (--tls-server-name), "
          "and valid now; {}; if the server does not encrypt its connections, leave out --tls-ca "
          "and ITN_TLS_CA",
          files.authority, server_name.empty() ? place->host : server_name,
          files.certificate.empty()
              ? "if it wants one of its clients, give --tls-cert and --tls-key"
              : fmt::format("it must accept that in {} (--tls-cert)", files.certificate));
    }
    message +=
        fmt::format(". If a server is there: {}. `openssl s_client -connect {}` shows its side",
                    hint, place->text());
  }
  return {status.error_code(), message};
}

}  // namespace itn
