// Servers and clients with and without TLS, certificates and tokens, and what they say when they do
// not fit together.
#include <gmock/gmock.h>
#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <memory>
#include <string>

#include "client/rpc/channel.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/rpc/host_port.h"
#include "itn/v1/render.grpc.pb.h"
#include "server/rpc/grpc_server.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/process.h"
#include "tests/support/test_authority.h"

namespace itn {
namespace {

using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kCapabilities = "/itn.v1.RenderService/GetCapabilities";
constexpr const char* kHealth = "/grpc.health.v1.Health/Check";

class AnsweringService final : public v1::RenderService::CallbackService {
 public:
  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* /*request*/,
                                            v1::Capabilities* /*reply*/) override {
    grpc::ServerUnaryReactor* const reactor = context->DefaultReactor();
    reactor->Finish(grpc::Status::OK);
    return reactor;
  }
};

class Server {
 public:
  explicit Server(const ServerSecurity& security, const std::string& listen = "127.0.0.1:0")
      : server_(
            {
                .listen = listen,
                .security = security,
                .max_message_bytes = 1 << 20,
                .transport_bytes = 0,
                .max_memory_bytes = 0,
            },
            service_, "itn.v1.RenderService") {}

  const std::string& address() const { return server_.address(); }

 private:
  AnsweringService service_;
  GrpcServer server_;
};

grpc::Status ask(const Connector& connector, const std::string& address,
                 const std::string& method = kCapabilities) {
  using google::protobuf::StringValue;
  grpc::TemplatedGenericStub<StringValue, StringValue> stub(connector.connect_to(address));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + testing::kPatience);
  const StringValue request;
  StringValue reply;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &reply,
                 [&](grpc::Status status) { done.set_value(std::move(status)); });
  return connector.with_cause(done.get_future().get(), address);
}

bool answers(const ClientSecurity& client, const Server& server) {
  return ask(Connector(client), server.address()).ok();
}

void expect_failure(const grpc::Status& status, grpc::StatusCode code, const std::string& why) {
  EXPECT_EQ(status.error_code(), code) << status.error_message();
  EXPECT_THAT(status.error_message(), HasSubstr(why));
}

void expect_unavailable(const ClientSecurity& client, const std::string& address,
                        const std::string& why) {
  expect_failure(ask(Connector(client), address), grpc::StatusCode::UNAVAILABLE, why);
}

class SecuredConnection : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (TestAuthority::is_possible()) {
      ours_ = new TestAuthority;
      theirs_ = new TestAuthority;
    }
  }
  static void TearDownTestSuite() {
    delete ours_;
    delete theirs_;
    ours_ = theirs_ = nullptr;
  }
  void SetUp() override {
    if (ours_ == nullptr) GTEST_SKIP() << "needs the program openssl";
  }

  static inline TestAuthority* ours_ = nullptr;
  static inline TestAuthority* theirs_ = nullptr;
};

// ---- Certificates ------------------------------------------------------------------------------

TEST_F(SecuredConnection, IsMadeByTls) {
  const Server server(ours_->server());
  EXPECT_TRUE(answers(ours_->anonymous_client(), server));
  EXPECT_TRUE(answers(ours_->client(), server));
}

TEST_F(SecuredConnection, IsMadeByMutualTlsWithClientsOfTheAuthorityAlone) {
  const Server server(ours_->server_of_known_clients());
  EXPECT_TRUE(answers(ours_->client(), server));
  expect_unavailable(ours_->anonymous_client(), server.address(),
                     "if it wants one of its clients, give --tls-cert and --tls-key");
  ClientSecurity stranger = theirs_->client();
  stranger.files.authority = ours_->path("ca.pem");
  expect_unavailable(stranger, server.address(),
                     "it must accept that in " + stranger.files.certificate + " (--tls-cert)");
}

TEST_F(SecuredConnection, IsNotMadeToAServerOfAnotherAuthority) {
  const Server server(theirs_->server());
  expect_unavailable(ours_->anonymous_client(), server.address(),
                     "of the authority in " + ours_->path("ca.pem") + " (--tls-ca)");
}

TEST_F(SecuredConnection, IsNotMadeToAServerOfAnotherName) {
  const Server server(ours_->server(), "127.0.0.2:0");
  ClientSecurity client = ours_->anonymous_client();
  expect_unavailable(client, server.address(), "for 127.0.0.2 (--tls-server-name)");
  client.server_name = "localhost";
  EXPECT_TRUE(answers(client, server));
  client.server_name = "elsewhere";
  expect_unavailable(client, server.address(), "for elsewhere (--tls-server-name)");
}

// Its address is not in the certificate.
TEST_F(SecuredConnection, IsMadeByANameThatIsLookedUp) {
  const TestAuthority authority;
  authority.certify_server("DNS:localhost");
  const Server server(authority.server());
  const HostPort name{"localhost", parse_host_port(server.address()).port};
  const ClientSecurity client = authority.anonymous_client();
  expect_unavailable(client, server.address(), "for 127.0.0.1 (--tls-server-name)");
  EXPECT_TRUE(ask(Connector(client), "dns:///" + name.text()).ok());
}

// Ours would not start with such a certificate, but a certificate expires while a server serves.
TEST_F(SecuredConnection, IsNotMadeToAServerWhoseCertificateHasExpired) {
  const TestAuthority authority;
  authority.let_server_expire();
  expect_error(ErrorKind::kInvalidInput, {"has expired"},
               [&] { const Server server(authority.server()); });
  grpc::SslServerCredentialsOptions options;
  options.pem_key_cert_pairs = {{read_file(authority.path("server.key"), "key"),
                                 read_file(authority.path("server.pem"), "certificate")}};
  AnsweringService service;
  int port = 0;
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::SslServerCredentials(options), &port);
  builder.RegisterService(&service);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  expect_unavailable(authority.anonymous_client(), "127.0.0.1:" + std::to_string(port),
                     "and valid now");
}

TEST_F(SecuredConnection, IsNotMadeIfOneSideAloneEncrypts) {
  const Server encrypted(ours_->server()), plain(ServerSecurity{});
  EXPECT_TRUE(answers({}, plain));
  expect_unavailable({}, encrypted.address(),
                     "if the server encrypts its connections, give --tls-ca");
  expect_unavailable(
      ours_->anonymous_client(), plain.address(),
      "if the server does not encrypt its connections, leave out --tls-ca and ITN_TLS_CA");
}

TEST_F(SecuredConnection, SaysNothingOfItsOwnWhereNobodyIs) {
  std::string address;
  {
    const Server server(ours_->server());
    address = server.address();
  }
  expect_unavailable(ours_->client(), address, "Connection refused");
  EXPECT_THAT(ask(Connector(ours_->client()), address).error_message(), Not(HasSubstr("openssl")));
}

TEST_F(SecuredConnection, WantsAllThatBelongsTogether) {
  ClientSecurity client = ours_->client();
  client.files.authority.clear();
  expect_error(ErrorKind::kUsage, {"--tls-cert", "without --tls-ca"},
               [&] { const Connector connector(client); });
  client = {};
  client.server_name = "localhost";
  expect_error(ErrorKind::kUsage, {"--tls-server-name", "without --tls-ca"},
               [&] { const Connector connector(client); });
  client = ours_->client();
  client.files.key = theirs_->path("client.key");
  expect_error(ErrorKind::kInvalidInput, {"is not that of the certificate"},
               [&] { const Connector connector(client); });
}

// ---- Certificates that are replaced ------------------------------------------------------------

// Files of one authority after the other, in place.
class ReplacedFiles {
 public:
  explicit ReplacedFiles(const TestAuthority& first) {
    for (const char* name : {"server.pem", "server.key", "ca.pem"}) take(first, name);
  }
  void take(const TestAuthority& authority, const std::string& name) const {
    copy_over(authority.path(name), path(name));
  }
  std::string path(const std::string& name) const { return folder_.path(name); }

 private:
  TemporaryFolder folder_;
};

TEST_F(SecuredConnection, TakesUpCertificatesThatAreReplaced) {
  const ReplacedFiles files(*ours_);
  const Server server(
      {.files = {files.path("server.pem"), files.path("server.key"), files.path("ca.pem")},
       .token_file = "",
       .insecure = false});
  ASSERT_TRUE(answers(ours_->client(), server));
  testing::CapturedLog log;
  // While they do not match, the former stay in use.
  files.take(*theirs_, "server.pem");
  EXPECT_TRUE(answers(ours_->client(), server));
  EXPECT_THAT(log.text(), HasSubstr("the former stays in use: the key"));
  files.take(*theirs_, "ca.pem");
  EXPECT_TRUE(answers(ours_->client(), server));
  files.take(*theirs_, "server.key");
  EXPECT_TRUE(answers(theirs_->client(), server));
  EXPECT_FALSE(answers(ours_->client(), server));
}

// The channel stays the same.
TEST_F(SecuredConnection, TakesUpAnAuthorityThatIsReplacedAtTheClient) {
  const ReplacedFiles files(*theirs_);
  const Server server(ours_->server());
  ClientSecurity client;
  client.files.authority = files.path("ca.pem");
  const Connector connector(client);
  const auto channel = connector.connect_to(server.address());
  const auto answered = [&] {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + testing::kPatience);
    v1::Capabilities reply;
    return v1::RenderService::NewStub(channel)->GetCapabilities(&context, {}, &reply).ok();
  };
  EXPECT_FALSE(answered());
  files.take(*ours_, "ca.pem");
  EXPECT_TRUE(eventually(answered));
}

// ---- Tokens ------------------------------------------------------------------------------------

const std::string kToken = "0123456789abcdef";
const std::string kOtherToken = "fedcba9876543210";

TEST(Token, IsWantedOfCallsButOfHealthChecks) {
  const TemporaryFolder folder;
  const Server server({.files = {}, .token_file = folder.write("server", kToken)});
  const auto with = [&](const std::string& token) {
    return Connector({.files = {}, .server_name = "", .token_file = folder.write("client", token)});
  };
  constexpr auto kRefused = grpc::StatusCode::UNAUTHENTICATED;
  EXPECT_TRUE(ask(with(kToken), server.address()).ok());
  expect_failure(ask(with(kOtherToken), server.address()), kRefused, "not one of this server's");
  const Connector without;
  expect_failure(ask(without, server.address()), kRefused, "this server wants a token");
  expect_failure(ask(without, server.address(), "/grpc.health.v1.Healthy/Check"), kRefused,
                 "wants a token");
  EXPECT_TRUE(ask(without, server.address(), kHealth).ok());
}

// A socket of this machine carries calls, and tokens, too.
TEST(Socket, IsAnAddress) {
  const TemporaryFolder folder;
  const std::string address = "unix:" + folder.path("socket");
  const Server server({.files = {}, .token_file = folder.write("server", kToken)}, address);
  EXPECT_EQ(server.address(), address);
  EXPECT_TRUE(
      ask(Connector({.files = {}, .server_name = "", .token_file = folder.write("client", kToken)}),
          address)
          .ok());
  expect_failure(ask(Connector(), address), grpc::StatusCode::UNAUTHENTICATED, "wants a token");
}

// gRPC takes the proxy of the environment, which does not lead to this machine; where it leads
// nowhere, the error names it.
TEST(Proxy, IsNamedWhereItLeadsNowhere) {
  ASSERT_EQ(setenv("http_proxy", "http://127.0.0.1:1", 1), 0);
  const Server server({});
  EXPECT_TRUE(ask(Connector(), server.address()).ok());
  const grpc::Status status = ask(Connector(), "192.0.2.1:50051");
  unsetenv("http_proxy");
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_THAT(status.error_message(), HasSubstr("http_proxy names a proxy"));
  EXPECT_THAT(status.error_message(), HasSubstr("no_proxy=192.0.2.1"));
}

// Who runs the server sees that somebody tries, and nothing of what.
TEST(Token, IsMissedInTheLogNowAndThen) {
  const TemporaryFolder folder;
  const testing::CapturedLog log;
  {
    const Server server({.files = {}, .token_file = folder.write("server", kToken)});
    const Connector stranger(
        {.files = {}, .server_name = "", .token_file = folder.write("client", kOtherToken)});
    for (int i = 0; i < 3; ++i) ask(stranger, server.address());
  }
  const std::string text = log.text();
  const size_t line = text.find("calls refused for want of a right token: 1;");
  EXPECT_NE(line, std::string::npos) << text;
  EXPECT_EQ(text.find("refused for want of a right token", text.find('\n', line)),
            std::string::npos);
  EXPECT_EQ(text.find(kToken), std::string::npos);
  EXPECT_EQ(text.find(kOtherToken), std::string::npos);
}

// On a connection that stays.
TEST(Token, MayChange) {
  const TemporaryFolder folder;
  const Server server({.files = {}, .token_file = folder.write("server", kToken)});
  const Connector connector(
      {.files = {}, .server_name = "", .token_file = folder.write("client", kToken)});
  const auto stub = v1::RenderService::NewStub(connector.connect_to(server.address()));
  const auto code = [&] {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + testing::kPatience);
    v1::Capabilities reply;
    return stub->GetCapabilities(&context, {}, &reply).error_code();
  };
  EXPECT_EQ(code(), grpc::StatusCode::OK);
  folder.write("server", kOtherToken + "\n" + kToken);
  EXPECT_EQ(code(), grpc::StatusCode::OK);
  folder.write("client", kOtherToken);
  EXPECT_EQ(code(), grpc::StatusCode::OK);
  folder.write("server", kOtherToken);
  EXPECT_EQ(code(), grpc::StatusCode::OK);
  folder.write("client", kToken);
  EXPECT_EQ(code(), grpc::StatusCode::UNAUTHENTICATED);
}

TEST(Token, StaysOnThisMachineWithoutTls) {
  const TemporaryFolder folder;
  const Connector connector(
      {.files = {}, .server_name = "", .token_file = folder.write("client", kToken)});
  for (const char* address :
       {"192.0.2.1:50051", "worker:50051", "dns:///worker:50051", "[2001:db8::1]:50051",
        "localhost.example.org:50051", "127.example.org:50051"}) {
    expect_error(ErrorKind::kUsage, {address, "unencrypted", "--tls-ca"},
                 [&] { connector.connect_to(address); });
  }
  for (const char* address :
       {"127.0.0.1:50051", "localhost:50051", "[::1]:50051", "dns:///localhost:50051"}) {
    EXPECT_NO_THROW(connector.connect_to(address)) << address;
  }
}

TEST_F(SecuredConnection, CarriesATokenByTls) {
  const TemporaryFolder folder;
  ServerSecurity security = ours_->server_of_known_clients();
  security.token_file = folder.write("token", kToken);
  const Server server(security);
  ClientSecurity client = ours_->client();
  expect_failure(ask(Connector(client), server.address()), grpc::StatusCode::UNAUTHENTICATED,
                 "wants a token");
  client.token_file = security.token_file;
  EXPECT_TRUE(answers(client, server));
}

// ---- Where servers listen ----------------------------------------------------------------------

TEST_F(SecuredConnection, IsWhatAServerBeyondThisMachineWants) {
  for (const char* address : {"0.0.0.0:0", "[::]:0"}) {
    expect_error(ErrorKind::kUsage, {address, "--tls-cert", "--insecure"},
                 [&] { const Server server(ServerSecurity{}, address); });
  }
  ServerSecurity trusting;
  trusting.insecure = true;
  EXPECT_NO_THROW(Server(trusting, "0.0.0.0:0"));
  EXPECT_NO_THROW(Server(ours_->server(), "0.0.0.0:0"));
  EXPECT_NO_THROW(Server(ServerSecurity{}, "127.3.2.1:0"));
}

}  // namespace
}  // namespace itn
