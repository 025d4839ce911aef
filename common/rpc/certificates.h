// Certificates and keys in PEM files, checked before anything relies on them.
#pragma once

#include <string>

namespace itn {

// Paths; empty: there is none.
struct CertificateFiles {
  std::string certificate;  // the own one first, then those between it and the authority's
  std::string key;          // its private key, without a passphrase
  std::string authority;    // one certificate or more, that the other side's must come from
};

// What is in the files.
struct Certificates {
  std::string certificate, key, authority;
};

// Whose the own certificate is.
enum class Side { kServer, kClient };

// Throws Error: kIo for a file that cannot be read; kInvalidInput for one that is not such PEM, a
// key of another certificate, a certificate that has expired or is not valid yet, and one whose
// extendedKeyUsage leaves this side out.
Certificates read_certificates(const CertificateFiles& files, Side side);

}  // namespace itn
