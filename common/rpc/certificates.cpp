#include "common/rpc/certificates.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <ctime>
#include <memory>
#include <vector>

#include "common/error.h"
#include "common/files/read_file.h"
#include "common/releaser.h"

namespace itn {
namespace {

using Bio = std::unique_ptr<BIO, Releaser<BIO_free>>;
using Certificate = std::unique_ptr<X509, Releaser<X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Releaser<EVP_PKEY_free>>;

constexpr uint64_t kMaxBytes = 1 << 20;  // the authorities that a browser trusts take a quarter

Bio reader_of(const std::string& pem) {
  return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

std::string as_text(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return "an unknown time";
  return fmt::format("{:%Y-%m-%d %H:%M} UTC", parts);
}

bool has_expired(const X509& certificate) {
  return X509_cmp_current_time(X509_get0_notAfter(&certificate)) < 0;
}

bool is_not_valid_yet(const X509& certificate) {
  return X509_cmp_current_time(X509_get0_notBefore(&certificate)) > 0;
}

// At least one.
std::vector<Certificate> parse_certificates(const std::string& pem, const std::string& path) {
  std::vector<Certificate> certificates;
  const Bio reader = reader_of(pem);
  ERR_clear_error();
  while (X509* next = PEM_read_bio_X509(reader.get(), nullptr, nullptr, nullptr)) {
    certificates.emplace_back(next);
  }
  const bool at_end = ERR_GET_REASON(ERR_peek_last_error()) == PEM_R_NO_START_LINE;
  ERR_clear_error();
  if (certificates.empty()) {
    throw invalid_input(
        fmt::format("{} has no certificate in PEM form (a text with \"-----BEGIN "
                    "CERTIFICATE-----\")",
                    path));
  }
  if (!at_end) {
    throw invalid_input(fmt::format("{}: the certificate after the first {} is damaged", path,
                                    certificates.size()));
  }
  return certificates;
}

Key parse_key(const std::string& pem, const std::string& path) {
  const Bio reader = reader_of(pem);
  bool wants_passphrase = false;
  // Without this, OpenSSL would ask for one on the terminal.
  const auto no_passphrase = [](char*, int, int, void* asked) {
    *static_cast<bool*>(asked) = true;
    return -1;
  };
  Key key(PEM_read_bio_PrivateKey(reader.get(), nullptr, no_passphrase, &wants_passphrase));
  ERR_clear_error();
  if (wants_passphrase) {
    throw invalid_input(
        fmt::format("{} is protected by a passphrase, which nobody is there to enter; \"openssl "
                    "pkey -in {} -out FILE\" writes it without",
                    path, path));
  }
  if (!key) {
    throw invalid_input(fmt::format(
        "{} has no private key in PEM form (a text with \"-----BEGIN PRIVATE KEY-----\")", path));
  }
  return key;
}

void require_valid_now(const X509& certificate, const std::string& path) {
  if (has_expired(certificate)) {
    throw invalid_input(
        fmt::format("the certificate {} has expired: it was valid until {}; renew it", path,
                    as_text(X509_get0_notAfter(&certificate))));
  }
  if (is_not_valid_yet(certificate)) {
    throw invalid_input(
        fmt::format("the certificate {} is not valid before {}; is the clock right?", path,
                    as_text(X509_get0_notBefore(&certificate))));
  }
}

// Requires what the other side will. A certificate that does not say what it is for is for both.
void require_purpose(X509& certificate, Side side, const std::string& path) {
  const bool server = side == Side::kServer;
  const uint32_t usage = X509_get_extended_key_usage(&certificate);  // all, if it does not say
  if ((usage & (server ? XKU_SSL_SERVER : XKU_SSL_CLIENT)) != 0) return;
  throw invalid_input(
      fmt::format("the certificate {} is not one for {}: its extendedKeyUsage lacks {}", path,
                  server ? "servers" : "clients", server ? "serverAuth" : "clientAuth"));
}

}  // namespace

Certificates read_certificates(const CertificateFiles& files, Side side) {
  Certificates read;
  if (!files.certificate.empty()) {
    read.certificate = read_file(files.certificate, "certificate", kMaxBytes);
    read.key = read_file(files.key, "key", kMaxBytes);
    const auto chain = parse_certificates(read.certificate, files.certificate);
    const Key key = parse_key(read.key, files.key);
    if (X509_check_private_key(chain.front().get(), key.get()) != 1) {
      ERR_clear_error();
      throw invalid_input(
          fmt::format("the key {} is not that of the certificate {} (of its first, "
                      "if it has several)",
                      files.key, files.certificate));
    }
    for (const auto& certificate : chain) require_valid_now(*certificate, files.certificate);
    require_purpose(*chain.front(), side, files.certificate);
  }
  if (!files.authority.empty()) {
    read.authority = read_file(files.authority, "authority's certificate", kMaxBytes);
    const auto authorities = parse_certificates(read.authority, files.authority);
    // One of several authorities, the former and the next for instance, must be of use.
    const bool any = std::ranges::any_of(
        authorities, [](const auto& a) { return !has_expired(*a) && !is_not_valid_yet(*a); });
    if (!any) require_valid_now(*authorities.front(), files.authority);
  }
  return read;
}

}  // namespace itn
