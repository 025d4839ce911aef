#include "common/rpc/listener.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "common/error.h"
#include "common/rpc/host_port.h"

namespace itn {
namespace {

using ::testing::HasSubstr;

TEST(Listener, TakesAFreePortAndSharesNone) {
  const Listener first("127.0.0.1:0", {});
  const HostPort taken = parse_host_port(first.address());
  EXPECT_EQ(taken.host, "127.0.0.1");
  EXPECT_NE(taken.port, 0);
  EXPECT_THROW(Listener(first.address(), {}), Error);
}

// All IPv4 addresses, and no other: the same port of IPv6 is still free.
TEST(Listener, AllOfIpv4IsNotIpv6) {
  const Listener four("0.0.0.0:0", {});
  const uint16_t port = parse_host_port(four.address()).port;
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
