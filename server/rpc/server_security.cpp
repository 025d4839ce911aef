#include "server/rpc/server_security.h"

#include <grpc/grpc_security.h>
#include <grpcpp/security/server_credentials.h>
#include <spdlog/spdlog.h>

#include <array>
#include <mutex>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "common/error.h"
#include "common/files/file_stamp.h"
#include "common/rpc/token_file.h"
#include "server/rpc/log_limit.h"

namespace itn {
namespace {

constexpr std::string_view kHealthService = "/grpc.health.v1.Health/";

// ---- Certificates ------------------------------------------------------------------------------

// Looks at the files when a connection comes. gRPC's own watcher of files takes a certificate and
// a key that do not match, as they are for a moment while both are replaced, and has none then.
class WatchedCertificates {
 public:
  explicit WatchedCertificates(CertificateFiles files)
      : files_(std::move(files)),
        stamps_(stamps()),
        next_(read_certificates(files_, Side::kServer)) {}

  // What gRPC is to use from now on; nothing if that is what it has.
  std::optional<Certificates> take_next() {
    const std::lock_guard lock(mutex_);
    if (const Stamps now = stamps(); now != stamps_) {
      stamps_ = now;
      try {
        next_ = read_certificates(files_, Side::kServer);
        spdlog::info("the certificate {} has been read again", files_.certificate);
      } catch (const Error& error) {
        spdlog::warn("the certificate has changed and cannot be used, the former stays in use: {}",
                     error.what());
      }
    }
    return std::exchange(next_, std::nullopt);
  }

 private:
  using Stamps = std::array<FileStamp, 3>;

  Stamps stamps() const {
    return {stamp_of(files_.certificate), stamp_of(files_.key), stamp_of(files_.authority)};
  }

  const CertificateFiles files_;
  std::mutex mutex_;
  Stamps stamps_;
  std::optional<Certificates> next_;
};

// gRPC calls it at the start, and for every connection.
grpc_ssl_certificate_config_reload_status fetch(void* watched,
                                                grpc_ssl_server_certificate_config** config) {
  const auto next = static_cast<WatchedCertificates*>(watched)->take_next();
  if (!next) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
  const grpc_ssl_pem_key_cert_pair own{next->key.c_str(), next->certificate.c_str()};
  // gRPC 1.51 wants an authority, even where it does not ask clients for a certificate.
  const std::string& authority = next->authority.empty() ? next->certificate : next->authority;
  *config = grpc_ssl_server_certificate_config_create(authority.c_str(), &own, 1);
  return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
}

grpc_server_credentials* tls_credentials(WatchedCertificates& watched, bool mutual) {
  return grpc_ssl_server_credentials_create_with_options(
      grpc_ssl_server_credentials_create_options_using_config_fetcher(
          mutual ? GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY
                 : GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE,
          fetch, &watched));
}

// ---- Tokens ------------------------------------------------------------------------------------

std::string_view text_of(const grpc_slice& slice) {
  return {reinterpret_cast<const char*>(GRPC_SLICE_START_PTR(slice)), GRPC_SLICE_LENGTH(slice)};
}

// Why a call is refused; null if it is not.
const char* refusal(TokenFile& tokens, std::span<const grpc_metadata> headers) {
  std::optional<std::string_view> authorization;
  for (const grpc_metadata& header : headers) {
    const std::string_view key = text_of(header.key);
    if (key == ":path" && text_of(header.value).starts_with(kHealthService)) return nullptr;
    if (key == "authorization") authorization = text_of(header.value);
  }
  if (!authorization) return "this server wants a token; give the client its file: --token-file";
  if (tokens.admits(std::string(*authorization))) return nullptr;
  return "the token is not one of this server's (--token-file)";
}

// A line now and then: whoever guesses tokens does not fill the disk.
void log_refusal(LogLimit& limit, const char* why) {
  const std::optional<uint64_t> left_out = limit.admit();
  if (!left_out) return;
  spdlog::warn("calls refused for want of a right token: {}; the last was told \"{}\"",
               *left_out + 1, why);
}

struct TokenCheck {
  explicit TokenCheck(const std::string& file) : tokens(file) {}

  TokenFile tokens;
  LogLimit log_limit{1, std::chrono::seconds(10)};
};

// gRPC calls it for every call.
void check_call(void* state, grpc_auth_context* /*context*/, const grpc_metadata* headers,
                size_t count, grpc_process_auth_metadata_done_cb done, void* call) {
  auto& check = *static_cast<TokenCheck*>(state);
  const char* const refused = refusal(check.tokens, {headers, count});
  if (refused) log_refusal(check.log_limit, refused);
  done(call, nullptr, 0, nullptr, 0, refused ? GRPC_STATUS_UNAUTHENTICATED : GRPC_STATUS_OK,
       refused);
}

// ---- Both --------------------------------------------------------------------------------------

// gRPC's C++ classes know neither certificates that a server fetches nor tokens without TLS; its C
// functions do.
class Credentials final : public grpc::ServerCredentials {
 public:
  explicit Credentials(const ServerSecurity& security) {
    if (security.encrypts()) watched_.emplace(security.files);
    if (!security.token_file.empty()) token_check_.emplace(security.token_file);
    credentials_ = watched_ ? tls_credentials(*watched_, !security.files.authority.empty())
                            : grpc_insecure_server_credentials_create();
    if (token_check_) {
      grpc_server_credentials_set_auth_metadata_processor(
          credentials_, {.process = check_call, .destroy = [](void*) {}, .state = &*token_check_});
    }
  }
  ~Credentials() override { grpc_server_credentials_release(credentials_); }
  Credentials(const Credentials&) = delete;
  Credentials& operator=(const Credentials&) = delete;

  // Nobody but ServerBuilder's plugins would call this; we have none that does.
  void SetAuthMetadataProcessor(
      const std::shared_ptr<grpc::AuthMetadataProcessor>& /*processor*/) override {}

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override {
    return grpc_server_add_http2_port(server, address.c_str(), credentials_);
  }

  std::optional<WatchedCertificates> watched_;
  std::optional<TokenCheck> token_check_;
  grpc_server_credentials* credentials_ = nullptr;
};

}  // namespace

std::shared_ptr<grpc::ServerCredentials> make_credentials(const ServerSecurity& security) {
  return std::make_shared<Credentials>(security);
}

}  // namespace itn
