#include "common/rpc/tls_diagnosis.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <netdb.h>
#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <array>
#include <cerrno>
#include <memory>
#include <optional>
#include <vector>

#include "common/files/file_descriptor.h"
#include "common/printable.h"
#include "common/rpc/host_port.h"
#include "common/rpc/openssl.h"

namespace itn {
namespace {

// For each step: connecting, and each answer of the server.
constexpr timeval kPatience{.tv_sec = 1, .tv_usec = 0};
constexpr int kMostAnswers = 16;

FileDescriptor connect_socket(const HostPort& place) {
  addrinfo hints = {};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(place.host.c_str(), std::to_string(place.port).c_str(), &hints, &found) != 0) {
    return FileDescriptor(-1);
  }
  const std::unique_ptr<addrinfo, openssl::Freeing<freeaddrinfo>> addresses(found);
  for (const addrinfo* address = found; address != nullptr; address = address->ai_next) {
    FileDescriptor fd(socket(address->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0));
    if (fd.get() < 0) continue;
    setsockopt(fd.get(), SOL_SOCKET, SO_SNDTIMEO, &kPatience, sizeof kPatience);
    setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof kPatience);
    if (connect(fd.get(), address->ai_addr, address->ai_addrlen) == 0) return fd;
  }
  return FileDescriptor(-1);
}

bool is_number(const std::string& host) {
  std::array<unsigned char, sizeof(in6_addr)> ignored{};
  return inet_pton(AF_INET, host.c_str(), ignored.data()) == 1 ||
         inet_pton(AF_INET6, host.c_str(), ignored.data()) == 1;
}

// A handshake that goes on whatever the server's certificate is, to see all that is wrong.
class Handshake {
 public:
  Handshake(int socket, const ClientSecurity& security, const std::string& name)
      : socket_(socket), context_(SSL_CTX_new(TLS_client_method())) {
    const CertificateFiles& files = security.files;
    SSL_CTX_set_verify(context_.get(), SSL_VERIFY_NONE, nullptr);
    if (security.encrypts()) SSL_CTX_load_verify_file(context_.get(), files.authority.c_str());
    if (!files.certificate.empty()) {
      SSL_CTX_use_certificate_chain_file(context_.get(), files.certificate.c_str());
      SSL_CTX_use_PrivateKey_file(context_.get(), files.key.c_str(), SSL_FILETYPE_PEM);
    }
    SSL_CTX_set_cert_cb(
        context_.get(),
        [](SSL*, void* asked) {
          *static_cast<bool*>(asked) = true;
          return 1;
        },
        &asked_for_certificate_);
    session_.reset(SSL_new(context_.get()));
    SSL_set_bio(session_.get(), BIO_new(BIO_s_mem()), BIO_new(BIO_s_mem()));
    constexpr std::array<unsigned char, 3> kHttp2{2, 'h', '2'};
    SSL_set_alpn_protos(session_.get(), kHttp2.data(), kHttp2.size());
    if (is_number(name)) {
      X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(session_.get()), name.c_str());
    } else {
      SSL_set_tlsext_host_name(session_.get(), name.c_str());
      SSL_set1_host(session_.get(), name.c_str());
    }
  }

  bool succeeds() {
    return proceed([this] { return SSL_connect(session_.get()); });
  }
  // Whether the server goes on to speak, as a gRPC server does at once.
  bool server_speaks() {
    char byte = 0;
    return proceed([&] { return SSL_read(session_.get(), &byte, 1); });
  }

  bool server_is_silent() const { return silent_; }
  // What it has sent begins like TLS, or like something else.
  bool server_speaks_tls() const { return first_byte_ >= 20 && first_byte_ <= 23; }
  bool server_speaks_otherwise() const { return first_byte_ >= 0 && !server_speaks_tls(); }
  bool asked_for_certificate() const { return asked_for_certificate_; }
  int64_t verification() const { return SSL_get_verify_result(session_.get()); }
  openssl::Certificate certificate() const {
    return openssl::Certificate(SSL_get1_peer_certificate(session_.get()));
  }

 private:
  // Repeats a step of OpenSSL until it is done, or fails; carries what the two sides say.
  template <typename Step>
  bool proceed(const Step& step) {
    for (int i = 0; i < kMostAnswers; ++i) {
      ERR_clear_error();
      const int result = step();
      const int error = SSL_get_error(session_.get(), result);
      say();
      if (result > 0) return true;
      if (error != SSL_ERROR_WANT_READ || !listen()) return false;
    }
    return false;
  }

  void say() {
    std::array<char, 4096> bytes{};
    for (int n = 0; (n = BIO_read(SSL_get_wbio(session_.get()), bytes.data(), bytes.size())) > 0;) {
      send(socket_, bytes.data(), static_cast<size_t>(n), MSG_NOSIGNAL);
    }
  }

  bool listen() {
    std::array<char, 4096> bytes{};
    const ssize_t n = recv(socket_, bytes.data(), bytes.size(), 0);
    silent_ = n < 0 && errno != ECONNRESET;
    if (n > 0 && first_byte_ < 0) first_byte_ = static_cast<unsigned char>(bytes[0]);
    return n > 0 && BIO_write(SSL_get_rbio(session_.get()), bytes.data(), static_cast<int>(n)) > 0;
  }

  int socket_;
  openssl::Context context_;
  openssl::Session session_;
  bool asked_for_certificate_ = false;
  bool silent_ = false;  // it neither spoke nor closed the connection
  int first_byte_ = -1;  // that it sent; -1: none yet
};

// What a certificate calls its owner: names and numbers.
std::string names_of(const X509& certificate) {
  std::vector<std::string> names;
  const openssl::Names all(static_cast<GENERAL_NAMES*>(
      X509_get_ext_d2i(&certificate, NID_subject_alt_name, nullptr, nullptr)));
  for (int i = 0; i < sk_GENERAL_NAME_num(all.get()); ++i) {
    int type = 0;
    const void* const value = GENERAL_NAME_get0_value(sk_GENERAL_NAME_value(all.get(), i), &type);
    if (type != GEN_DNS && type != GEN_IPADD) continue;
    const auto* const text = static_cast<const ASN1_STRING*>(value);
    const unsigned char* const bytes = ASN1_STRING_get0_data(text);
    const int length = ASN1_STRING_length(text);
    // Whoever made the certificate says how long it is.
    if (type == GEN_IPADD && length != 4 && length != 16) continue;
    std::array<char, INET6_ADDRSTRLEN> number{};
    if (type == GEN_DNS) {
      names.push_back(
          printable({reinterpret_cast<const char*>(bytes), static_cast<size_t>(length)}));
    } else if (inet_ntop(length == 4 ? AF_INET : AF_INET6, bytes, number.data(), number.size())) {
      names.emplace_back(number.data());
    }
  }
  return names.empty() ? "nothing" : fmt::format("{}", fmt::join(names, ", "));
}

std::string what_is_wrong_with(const X509& certificate, int64_t verification,
                               const std::string& name, const std::string& authority) {
  switch (verification) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return fmt::format(
          "the server's certificate, or that of its authority, has expired (its own "
          "is valid until {}): renew it, or see whether this machine's clock is right",
          expiry_of(certificate));
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return "the server's certificate is not valid yet: is this machine's clock right?";
    case X509_V_ERR_HOSTNAME_MISMATCH:
    case X509_V_ERR_IP_ADDRESS_MISMATCH:
      return fmt::format(
          "the server's certificate is not for {}, but for {}: use such an address, "
          "or give --tls-server-name",
          printable(name), names_of(certificate));
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
    case X509_V_ERR_CERT_SIGNATURE_FAILURE:
      return fmt::format(
          "the server's certificate does not come from the authority in {} "
          "(--tls-ca)",
          authority);
    default:
      return fmt::format("the server's certificate cannot be trusted: {}",
                         X509_verify_cert_error_string(verification));
  }
}

std::string what_is_wrong_with_ours(const CertificateFiles& files) {
  return files.certificate.empty()
             ? "the server wants a certificate of its clients: give --tls-cert and --tls-key"
             : fmt::format(
                   "the server does not accept the certificate {}: has it expired, does it "
                   "not come from the authority in the server's --tls-client-ca, or is it not one "
                   "for clients (extendedKeyUsage)?",
                   files.certificate);
}

}  // namespace

std::string diagnose_connection(const std::string& address, const ClientSecurity& security) {
  const std::optional<HostPort> place = endpoint_of_target(address);
  if (!place) return {};
  const FileDescriptor socket = connect_socket(*place);
  if (socket.get() < 0) return {};
  const std::string name = security.server_name.empty() ? place->host : security.server_name;
  Handshake handshake(socket.get(), security, name);
  const bool done = handshake.succeeds();
  if (!security.encrypts()) {
    return handshake.server_speaks_tls()
               ? "the server encrypts its connections: give --tls-ca, the certificate of the "
                 "authority that its certificate comes from"
               : "";
  }
  if (handshake.server_speaks_otherwise()) {
    return "the server does not encrypt its connections: start it with --tls-cert and --tls-key, "
           "or leave out --tls-ca, and ITN_TLS_CA in the environment";
  }
  const openssl::Certificate certificate = handshake.certificate();
  if (certificate && handshake.verification() != X509_V_OK) {
    return what_is_wrong_with(*certificate, handshake.verification(), name,
                              security.files.authority);
  }
  const bool accepted = done && handshake.server_speaks();
  if (handshake.asked_for_certificate() && !accepted && !handshake.server_is_silent()) {
    return what_is_wrong_with_ours(security.files);
  }
  return {};
}

}  // namespace itn
