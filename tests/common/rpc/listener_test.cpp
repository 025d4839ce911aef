#include "common/rpc/listener.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "common/error.h"

namespace itn {
namespace {

using ::testing::HasSubstr;

TEST(ListenAddress, IsHostAndPort) {
  const auto is = [](const std::string& text, const std::string& host, int port) {
    const ListenAddress address = parse_listen_address(text);
    EXPECT_EQ(address.host, host) << text;
    EXPECT_EQ(address.port, port) << text;
  };
  is("127.0.0.1:50051", "127.0.0.1", 50051);
  is("0.0.0.0:0", "0.0.0.0", 0);
  is("localhost:65535", "localhost", 65535);
  is("[::1]:80", "::1", 80);
  is("[fe80::1%eth0]:80", "fe80::1%eth0", 80);
}

struct Row {
  const char* text;
  const char* why;
};

TEST(ListenAddress, IsNothingElse) {
  const Row rows[] = {
      {"", "it has no port"},
      {"127.0.0.1", "it has no port"},
      {"50051", "it has no port"},
      {":99999", "it has no host"},
      {":50051", "it has no host"},
      {"127.0.0.1:99999", "[0, 65535]"},
      {"127.0.0.1:", "[0, 65535]"},
      {"127.0.0.1:-1", "[0, 65535]"},
      {"127.0.0.1:+1", "[0, 65535]"},
      {"127.0.0.1:80 ", "[0, 65535]"},
      {"127.0.0.1:0x50", "[0, 65535]"},
      {"127.0.0.1:http", "[0, 65535]"},
      {"::1:80", "in brackets"},
      {"[::1]", "in brackets"},
      {"[localhost]:80", "must be an IPv6 address"},
      {"unix:/tmp/socket:1", "in brackets"},
      {"a b:80", "neither a name nor a number"},
      {"dns:///a:80", "in brackets"},
  };
  for (const Row& row : rows) {
    try {
      parse_listen_address(row.text);
      ADD_FAILURE() << row.text << " was taken";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kUsage);
      EXPECT_THAT(error.what(), HasSubstr(row.why)) << row.text;
    }
  }
}

TEST(Listener, TakesAFreePortAndSharesNone) {
  const Listener first("127.0.0.1:0", {});
  const ListenAddress taken = parse_listen_address(first.address());
  EXPECT_EQ(taken.host, "127.0.0.1");
  EXPECT_NE(taken.port, 0);
  EXPECT_THROW(Listener(first.address(), {}), Error);
}

// All IPv4 addresses, and no other: the same port of IPv6 is still free.
TEST(Listener, AllOfIpv4IsNotIpv6) {
  const Listener four("0.0.0.0:0", {});
  const uint16_t port = parse_listen_address(four.address()).port;
  EXPECT_THROW(Listener("127.0.0.1:" + std::to_string(port), {}), Error);
  try {
    const Listener six("[::1]:" + std::to_string(port), {});
    EXPECT_EQ(six.address(), "[::1]:" + std::to_string(port));
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::AnyOf(HasSubstr("Cannot assign requested address"),
                                               HasSubstr("not supported")));
    GTEST_SKIP() << "no IPv6 here";
  }
}

TEST(Listener, NamesAHostThatIsNotThere) {
  try {
    const Listener listener("no.such.host.invalid:0", {});
    FAIL() << "it listens";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUsage);
    EXPECT_THAT(error.what(), HasSubstr("no.such.host.invalid"));
  }
}

}  // namespace
}  // namespace itn
