#include "common/rpc/certificates.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/paths.h"
#include "tests/support/test_authority.h"

namespace itn {
namespace {

using namespace testing;

class CertificatesTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (TestAuthority::is_possible()) authority_ = new TestAuthority;
  }
  static void TearDownTestSuite() {
    delete authority_;
    authority_ = nullptr;
  }
  void SetUp() override {
    if (authority_ == nullptr) GTEST_SKIP() << "needs the program openssl";
  }

  static std::string path(const std::string& name) { return authority_->path(name); }

  static void expect_refusal(ErrorKind kind, const std::vector<std::string>& parts,
                             const CertificateFiles& files) {
    expect_error(kind, parts, [&] { read_certificates(files, Side::kServer); });
  }

  static inline TestAuthority* authority_ = nullptr;
};

TEST_F(CertificatesTest, AreReadAsTheyAre) {
  const Certificates read =
      read_certificates({path("server.pem"), path("server.key"), path("ca.pem")}, Side::kServer);
  EXPECT_TRUE(read.certificate.starts_with("-----BEGIN CERTIFICATE-----")) << read.certificate;
  EXPECT_TRUE(read.key.starts_with("-----BEGIN PRIVATE KEY-----"));
  EXPECT_TRUE(read.authority.starts_with("-----BEGIN CERTIFICATE-----")) << read.authority;
  EXPECT_NE(read.certificate, read.authority);
  EXPECT_EQ(read_certificates({}, Side::kServer).certificate, "");
}

TEST_F(CertificatesTest, MayBeAChain) {
  authority_->shell("cat server.pem ca.pem >chain.pem");
  EXPECT_NO_THROW(read_certificates({path("chain.pem"), path("server.key"), ""}, Side::kServer));
  // The key must be that of the first.
  authority_->shell("cat ca.pem server.pem >reversed.pem");
  expect_refusal(ErrorKind::kInvalidInput, {"reversed.pem (of its first"},
                 {path("reversed.pem"), path("server.key"), ""});
}

TEST_F(CertificatesTest, SayWhatIsWrongWithThem) {
  const auto kBad = ErrorKind::kInvalidInput;
  expect_refusal(ErrorKind::kIo, {"cannot read the certificate", "none.pem"},
                 {path("none.pem"), path("server.key"), ""});
  expect_refusal(ErrorKind::kIo, {"cannot read the key", "none.key"},
                 {path("server.pem"), path("none.key"), ""});
  expect_refusal(kBad, {"the key", "client.key is not that of the certificate", "server.pem"},
                 {path("server.pem"), path("client.key"), ""});
  expect_refusal(kBad, {"server.key has no certificate in PEM form"},
                 {path("server.key"), path("server.key"), ""});
  expect_refusal(kBad, {"server.pem has no private key in PEM form"},
                 {path("server.pem"), path("server.pem"), ""});
  expect_refusal(kBad, {"server.key has no certificate in PEM form"}, {"", "", path("server.key")});
  authority_->shell("head -c 400 server.pem >cut.pem; (cat server.pem; cat cut.pem) >half.pem");
  expect_refusal(kBad, {"cut.pem has no certificate"}, {path("cut.pem"), path("server.key"), ""});
  expect_refusal(kBad, {"half.pem: the certificate after the first 1 is damaged"},
                 {path("half.pem"), path("server.key"), ""});
  authority_->shell("openssl pkey -in server.key -aes256 -passout pass:secret -out locked.key");
  expect_refusal(kBad, {"locked.key is protected by a passphrase"},
                 {path("server.pem"), path("locked.key"), ""});
}

// The other side would refuse it: "unsuitable certificate purpose".
TEST_F(CertificatesTest, AreForTheSideThatShowsThem) {
  const CertificateFiles server{path("server.pem"), path("server.key"), ""};
  const CertificateFiles client{path("client.pem"), path("client.key"), ""};
  EXPECT_NO_THROW(read_certificates(client, Side::kClient));
  expect_error(ErrorKind::kInvalidInput, {"client.pem is not one for servers", "serverAuth"},
               [&] { read_certificates(client, Side::kServer); });
  expect_error(ErrorKind::kInvalidInput, {"server.pem is not one for clients", "clientAuth"},
               [&] { read_certificates(server, Side::kClient); });
  // One that does not say.
  const TestAuthority other;
  other.certify_server("IP:127.0.0.1");
  for (const Side side : {Side::kServer, Side::kClient}) {
    EXPECT_NO_THROW(
        read_certificates({other.path("server.pem"), other.path("server.key"), ""}, side));
  }
}

TEST_F(CertificatesTest, AreInTime) {
  const TestAuthority other;
  other.let_server_expire();
  expect_refusal(ErrorKind::kInvalidInput, {"server.pem has expired: it was valid until 20", "UTC"},
                 {other.path("server.pem"), other.path("server.key"), ""});
  // One of several authorities must be.
  other.shell("cat server.pem ca.pem >both.pem");
  EXPECT_NO_THROW(read_certificates({"", "", other.path("both.pem")}, Side::kServer));
  expect_refusal(ErrorKind::kInvalidInput, {"server.pem has expired"},
                 {"", "", other.path("server.pem")});
}

// A folder that is left behind would be taken for that of an authority.
TEST(MakeTestCa, ChecksNamesBeforeItMakesAnything) {
  const testing::TemporaryFolder folder;
  const std::string made = folder.path("ca");
  EXPECT_NE(std::system((testing::source("deploy/make-test-ca.sh") + " '" + made +
                         "' 'host one' 2>/dev/null")
                            .c_str()),
            0);
  EXPECT_FALSE(std::filesystem::exists(made));
}

}  // namespace
}  // namespace itn
