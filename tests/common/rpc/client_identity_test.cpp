#include "common/rpc/client_identity.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

TEST(HostOfPeer, IsWithoutThePort) {
  EXPECT_EQ(host_of_peer("ipv4:10.0.0.1:50123"), "ipv4:10.0.0.1");
  EXPECT_EQ(host_of_peer("ipv6:%5B::1%5D:50123"), "ipv6:%5B::1%5D");
  EXPECT_EQ(host_of_peer("unix:/run/itn:7"), "unix:/run/itn:7");
  EXPECT_EQ(host_of_peer("inproc"), "inproc");
}

}  // namespace
}  // namespace itn
