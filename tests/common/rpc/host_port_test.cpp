#include "common/rpc/host_port.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using testing::expect_error;

TEST(HostPort, IsReadAndWritten) {
  const auto is = [](const std::string& text, const HostPort& expected) {
    const HostPort read = parse_host_port(text, PortZero::kAnyFree);
    EXPECT_EQ(read.host, expected.host) << text;
    EXPECT_EQ(read.port, expected.port) << text;
    EXPECT_EQ(read.text(), text);
  };
  is("127.0.0.1:50051", {"127.0.0.1", 50051});
  is("0.0.0.0:0", {"0.0.0.0", 0});
  is("localhost:65535", {"localhost", 65535});
  is("127.example.org:1", {"127.example.org", 1});
  is("[::1]:80", {"::1", 80});
  is("[fe80::1%eth0]:80", {"fe80::1%eth0", 80});
}

struct Row {
  const char* text;
  const char* why;
};

TEST(HostPort, IsNothingElse) {
  const Row rows[] = {
      {"", "it has no port"},
      {"127.0.0.1", "it has no port"},
      {"50051", "it has no port"},
      {"[::1]", "it has no port"},
      {":99999", "it has no host"},
      {":50051", "it has no host"},
      {"127.0.0.1:99999", "[0, 65535]"},
      {"127.0.0.1:4294967297", "[0, 65535]"},
      {"127.0.0.1:", "[0, 65535]"},
      {"127.0.0.1:-1", "[0, 65535]"},
      {"127.0.0.1:+1", "[0, 65535]"},
      {"127.0.0.1:80 ", "[0, 65535]"},
      {"127.0.0.1:0x50", "[0, 65535]"},
      {"127.0.0.1:http", "[0, 65535]"},
      {"::1", "in brackets"},
      {"::1:80", "in brackets"},
      {"fe80::1:50051", "in brackets"},
      {"[::1", "in brackets"},
      {"[::1:80", "in brackets"},
      {"[localhost]:80", "must be an IPv6 address"},
      {"[]:80", "must be an IPv6 address"},
      {"a b:80", "neither a name nor a number"},
      {"unix:/tmp/socket:1", "neither a name nor a number"},
      {"dns:///a:80", "neither a name nor a number"},
  };
  for (const Row& row : rows) {
    expect_error(ErrorKind::kUsage,
                 {fmt::format("\"{}\"", row.text), row.why, "give HOST:PORT or [IPV6]:PORT"},
                 [&] { parse_host_port(row.text, PortZero::kAnyFree); });
  }
}

TEST(HostPort, HasPortZeroToListenOnAlone) {
  EXPECT_EQ(parse_host_port("a:0", PortZero::kAnyFree).port, 0);
  expect_error(ErrorKind::kUsage, {"[1, 65535]"}, [] { parse_host_port("a:0"); });
}

TEST(HostPort, IsLoopbackByItsNumberNotByItsBeginning) {
  for (const char* text :
       {"127.0.0.1:1", "127.3.2.1:1", "[::1]:1", "[0:0:0:0:0:0:0:1]:1", "localhost:1"}) {
    EXPECT_TRUE(parse_host_port(text).is_loopback()) << text;
  }
  for (const char* text : {"127.example.org:1", "localhost.example.org:1", "128.0.0.1:1",
                           "0.0.0.0:1", "[::]:1", "[::2]:1", "[2001:db8::1]:1"}) {
    EXPECT_FALSE(parse_host_port(text).is_loopback()) << text;
  }
}

TEST(EndpointOfTarget, IsThatOfAnAddressOrAName) {
  EXPECT_EQ(endpoint_of_target("a:1"), (HostPort{"a", 1}));
  EXPECT_EQ(endpoint_of_target("[::1]:2"), (HostPort{"::1", 2}));
  EXPECT_EQ(endpoint_of_target("dns:a:1"), (HostPort{"a", 1}));
  EXPECT_EQ(endpoint_of_target("dns:///a:1"), (HostPort{"a", 1}));
  EXPECT_EQ(endpoint_of_target("dns:///[::1]:2"), (HostPort{"::1", 2}));
  for (const char* other :
       {"", "a", "a:0", "dns:///", "dns:///a", "dns://server/a:1", "unix:1", "unix:/run/worker",
        "unix-abstract:1", "ipv4:10.0.0.1:1", "ipv6:[::1]:1"}) {
    EXPECT_EQ(endpoint_of_target(other), std::nullopt) << other;
  }
}

TEST(HostOfPeer, IsWithoutThePort) {
  EXPECT_EQ(host_of_peer("ipv4:10.0.0.1:50123"), "ipv4:10.0.0.1");
  EXPECT_EQ(host_of_peer("ipv6:%5B::1%5D:50123"), "ipv6:%5B::1%5D");
  EXPECT_EQ(host_of_peer("unix:/run/itn:7"), "unix:/run/itn:7");
  EXPECT_EQ(host_of_peer("inproc"), "inproc");
}

}  // namespace
}  // namespace itn
