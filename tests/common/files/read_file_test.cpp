#include "common/files/read_file.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using namespace testing;

TEST(ReadFile, ReadsEverySize) {
  const TemporaryFolder folder;
  for (const size_t size : {0U, 1U, 4096U, 65536U, 300'001U}) {
    std::string bytes(size, '\0');
    for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<char>(i * 7);
    EXPECT_EQ(read_file(folder.write("file", bytes), "file"), bytes);
  }
}

TEST(ReadFile, FollowsLinks) {
  const TemporaryFolder folder;
  folder.write("file", "content");
  fs::create_symlink("file", folder.path() / "link");
  EXPECT_EQ(read_file(folder.path() / "link", "file"), "content");
}

// The files of /proc claim to be empty.
TEST(ReadFile, ReadsWhatDoesNotSayItsSize) {
  EXPECT_NE(read_file("/proc/self/status", "file").find("Name:"), std::string::npos);
}

TEST(ReadFile, ReadsStandardInput) {
  const TemporaryFolder folder;
  const int saved = ::dup(STDIN_FILENO);
  ASSERT_NE(std::freopen(folder.write("file", "content").c_str(), "r", stdin), nullptr);
  EXPECT_EQ(read_file_or_stdin("-", "scene"), "content");
  ::dup2(saved, STDIN_FILENO);
  ::close(saved);
}

TEST(ReadFile, RefusesMoreThanIsAsked) {
  const TemporaryFolder folder;
  const auto file = folder.write("file", std::string(1000, 'x'));
  EXPECT_EQ(read_file(file, "scene", 1000).size(), 1000U);
  expect_error(ErrorKind::kInvalidInput, {"the scene", "file", "1000 bytes", "at most 999"},
               [&] { read_file(file, "scene", 999); });
  // It claims nothing, but has more.
  expect_error(ErrorKind::kInvalidInput, {"more than 10 bytes"},
               [&] { read_file("/proc/self/status", "scene", 10); });
  // Sparse: takes no room on the disk, and must take none in memory.
  fs::resize_file(file, uintmax_t{1} << 40);
  expect_error(ErrorKind::kInvalidInput, {"1099511627776 bytes"},
               [&] { read_file(file, "scene"); });
}

TEST(ReadFile, RefusesWhatIsNotARegularFile) {
  const TemporaryFolder folder;
  expect_error(ErrorKind::kIo, {"cannot read the scene", "gone", "No such file"},
               [&] { read_file(folder.path() / "gone", "scene"); });
  expect_error(ErrorKind::kIo, {"it is a folder"}, [&] { read_file(folder.path(), "scene"); });
  const fs::path fifo = folder.path() / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  expect_error(ErrorKind::kIo, {"it is a FIFO"}, [&] { read_file(fifo, "scene"); });
  expect_error(ErrorKind::kIo, {"it is a device"}, [&] { read_file("/dev/zero", "scene"); });
  const int unreadable = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{.sun_family = AF_UNIX, .sun_path = {}};
  const std::string socket = folder.path("s");
  ASSERT_LT(socket.size(), sizeof address.sun_path);
  std::strcpy(address.sun_path, socket.c_str());
  ASSERT_EQ(::bind(unreadable, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  expect_error(ErrorKind::kIo, {socket}, [&] { read_file(socket, "scene"); });
  ::close(unreadable);
}

}  // namespace
}  // namespace itn
