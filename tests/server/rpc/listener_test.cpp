#include "server/rpc/listener.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/rpc/host_port.h"
#include "tests/support/temporary_folder.h"

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

TEST(Listener, MakesASocketInTheFileSystem) {
  const testing::TemporaryFolder folder;
  const std::string path = folder.path("socket"), address = "unix:" + path;
  {
    const Listener listener(address, {.this_machine_only = true});
    EXPECT_EQ(listener.address(), address);
    EXPECT_TRUE(std::filesystem::is_socket(path));
    EXPECT_THROW(Listener(address, {}), Error);  // it is listened on
  }
  EXPECT_FALSE(std::filesystem::exists(path));
  // One that a process left behind is replaced; a file is not.
  const int left = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un name = {};
  name.sun_family = AF_UNIX;
  path.copy(name.sun_path, sizeof name.sun_path - 1);
  ASSERT_EQ(bind(left, reinterpret_cast<const sockaddr*>(&name), sizeof name), 0);
  close(left);
  EXPECT_EQ(Listener(address, {}).address(), address);
  std::ofstream(path) << "mine";
  EXPECT_THROW(Listener(address, {}), Error);
  EXPECT_TRUE(std::filesystem::is_regular_file(path));
  EXPECT_THROW(Listener("unix:", {}), Error);
  EXPECT_THROW(Listener("unix:" + std::string(200, 'a'), {}), Error);
}

// A connection to a listener, from an address of this machine.
class Caller {
 public:
  Caller(const Listener& listener, const char* from) : fd_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in here = {};
    here.sin_family = AF_INET;
    inet_pton(AF_INET, from, &here.sin_addr);
    EXPECT_EQ(bind(fd_, reinterpret_cast<sockaddr*>(&here), sizeof here), 0);
    inet_pton(AF_INET, "127.0.0.1", &here.sin_addr);
    here.sin_port = htons(parse_host_port(listener.address()).port);
    EXPECT_EQ(connect(fd_, reinterpret_cast<sockaddr*>(&here), sizeof here), 0);
  }
  Caller(Caller&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  ~Caller() {
    if (fd_ >= 0) close(fd_);
  }

  // The listener's owner greets those that are taken; others are closed.
  bool is_taken() const {
    char greeting = 0;
    return recv(fd_, &greeting, 1, 0) == 1;
  }

 private:
  int fd_;
};

TEST(Listener, LeavesRoomForOtherAddresses) {
  Listener listener("127.0.0.1:0", {.max_connections = 8});
  std::vector<int> taken;
  listener.start([&](int fd) {
    EXPECT_EQ(send(fd, "!", 1, 0), 1);
    taken.push_back(fd);
  });
  std::vector<Caller> callers;
  const auto taken_of = [&](const char* from, int calls) {
    int count = 0;
    for (int i = 0; i < calls; ++i) {
      callers.emplace_back(listener, from);
      count += callers.back().is_taken() ? 1 : 0;
    }
    return count;
  };
  EXPECT_EQ(taken_of("127.0.0.1", 20), 4);  // a half
  EXPECT_EQ(taken_of("127.0.0.2", 20), 2);  // of what is left
  EXPECT_EQ(taken_of("127.0.0.3", 20), 1);
  EXPECT_EQ(taken_of("127.0.0.4", 20), 1);
  EXPECT_EQ(listener.connections(), 8U);
  listener.close();
  for (const int fd : taken) close(fd);
}

}  // namespace
}  // namespace itn
