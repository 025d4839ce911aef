#include "common/files/atomic_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <array>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using namespace testing;

std::string contents(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

size_t files_in(const fs::path& folder) {
  return static_cast<size_t>(std::distance(fs::directory_iterator(folder), {}));
}

struct stat status_of(const fs::path& path) {
  struct stat status {};
  EXPECT_EQ(::lstat(path.c_str(), &status), 0) << path;
  return status;
}

TEST(AtomicFile, AReaderSeesTheOldContentOrTheNew) {
  const TemporaryFolder folder;
  const std::string a(1 << 20, 'a'), b(1 << 19, 'b');
  const auto target = folder.write("target", a);
  std::thread writer([&] {
    for (int i = 0; i < 50; ++i) write_file_atomically(target, i % 2 ? a : b);
  });
  for (int i = 0; i < 50; ++i) {
    const std::string read = contents(target);
    EXPECT_TRUE(read == a || read == b) << read.size();
  }
  writer.join();
  EXPECT_EQ(files_in(folder.path()), 1U);
}

TEST(AtomicFile, TwoWritersOfOneTargetDoNotMeet) {
  const TemporaryFolder folder;
  const fs::path target = folder.path() / "target";
  const auto write = [&](char c) {
    for (int i = 0; i < 50; ++i) write_file_atomically(target, std::string(100'000, c));
  };
  std::thread a(write, 'a'), b(write, 'b');
  a.join();
  b.join();
  const std::string read = contents(target);
  EXPECT_EQ(read, std::string(100'000, read.front()));
  EXPECT_EQ(files_in(folder.path()), 1U);
}

TEST(AtomicFile, LeavesTheOldContentAndNothingElseIfItFails) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path() / "target");
  expect_error(ErrorKind::kIo, {"target", "it is a folder"},
               [&] { write_file_atomically(folder.path() / "target", "x"); });
  EXPECT_EQ(files_in(folder.path()), 1U);
}

TEST(AtomicFile, HasThePermissionsThatTheUmaskLeaves) {
  const TemporaryFolder folder;
  const mode_t before = ::umask(027);
  write_file_atomically(folder.path() / "target", "x");
  ::umask(before);
  EXPECT_EQ(status_of(folder.path() / "target").st_mode & 0777U, 0640U);
}

TEST(AtomicFile, KeepsThePermissionsOfTheFileItReplaces) {
  const TemporaryFolder folder;
  const auto target = folder.write("target", "old");
  for (const unsigned mode : {0600U, 0666U, 0755U}) {
    ASSERT_EQ(::chmod(target.c_str(), mode), 0);
    write_file_atomically(target, "new");
    EXPECT_EQ(status_of(target).st_mode & 07777U, mode);
  }
}

TEST(AtomicFile, KeepsTheOwnerOfTheFileItReplaces) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root may give files away";
  const TemporaryFolder folder;
  const auto target = folder.write("target", "old");
  ASSERT_EQ(::chown(target.c_str(), 1234, 5678), 0);
  write_file_atomically(target, "new");
  EXPECT_EQ(contents(target), "new");
  EXPECT_EQ(status_of(target).st_uid, 1234U);
  EXPECT_EQ(status_of(target).st_gid, 5678U);
}

TEST(AtomicFile, WritesBytesAsTheyAre) {
  const TemporaryFolder folder;
  const std::string bytes("a\0\r\n\xff", 5);
  write_file_atomically(folder.path() / "target", bytes);
  EXPECT_EQ(contents(folder.path() / "target"), bytes);
}

// --- Links ---

TEST(AtomicFile, WritesWhereAChainOfLinksLeads) {
  const TemporaryFolder folder;
  fs::create_directories(folder.path() / "far");
  folder.write("far/real", "old");
  fs::create_symlink("real", folder.path() / "far/inner");
  fs::create_symlink(folder.path() / "far/inner", folder.path() / "outer");
  write_file_atomically(folder.path() / "outer", "new");
  EXPECT_EQ(contents(folder.path() / "far/real"), "new");
  EXPECT_TRUE(fs::is_symlink(folder.path() / "outer"));
  EXPECT_TRUE(fs::is_symlink(folder.path() / "far/inner"));
  EXPECT_FALSE(fs::is_symlink(folder.path() / "far/real"));
  EXPECT_EQ(files_in(folder.path()), 2U);
  EXPECT_EQ(files_in(folder.path() / "far"), 2U);
}

TEST(AtomicFile, CreatesWhatADanglingLinkLeadsTo) {
  const TemporaryFolder folder;
  fs::create_directories(folder.path() / "far");
  fs::create_symlink("far/real", folder.path() / "link");
  check_writable(folder.path() / "link");
  EXPECT_EQ(files_in(folder.path() / "far"), 0U);
  write_file_atomically(folder.path() / "link", "new");
  EXPECT_TRUE(fs::is_symlink(folder.path() / "link"));
  EXPECT_EQ(contents(folder.path() / "far/real"), "new");
}

TEST(AtomicFile, RefusesLinksInACircle) {
  const TemporaryFolder folder;
  fs::create_symlink("b", folder.path() / "a");
  fs::create_symlink("a", folder.path() / "b");
  expect_error(ErrorKind::kIo, {"/a:", "symbolic links"},
               [&] { write_file_atomically(folder.path() / "a", "x"); });
  EXPECT_EQ(files_in(folder.path()), 2U);
}

// --- What is not a regular file ---

TEST(AtomicFile, WritesIntoAFifo) {
  const TemporaryFolder folder;
  const fs::path fifo = folder.path() / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  check_writable(fifo);  // does not wait for the reader
  const std::string bytes(300'000, 'x');
  std::string read;
  std::thread reader([&] { read = contents(fifo); });
  write_file_atomically(fifo, bytes);
  reader.join();
  EXPECT_EQ(read, bytes);
  EXPECT_TRUE(S_ISFIFO(status_of(fifo).st_mode));
  EXPECT_EQ(files_in(folder.path()), 1U);
}

// A node of its own: the machine needs /dev/null and /dev/full if this fails.
class DeviceTest : public ::testing::Test {
 protected:
  void make(unsigned minor) {
    if (::mknod(device_.c_str(), S_IFCHR | 0600, makedev(1, minor)) != 0) {
      GTEST_SKIP() << "device nodes cannot be created here";
    }
    const int fd = ::open(device_.c_str(), O_WRONLY);
    if (fd < 0) GTEST_SKIP() << "device nodes cannot be opened here";
    ::close(fd);
  }
  void expect_device() const {
    EXPECT_TRUE(S_ISCHR(status_of(device_).st_mode));
    EXPECT_EQ(files_in(folder_.path()), 1U);
  }

  TemporaryFolder folder_;
  fs::path device_ = folder_.path() / "device";
};

TEST_F(DeviceTest, IsWrittenInto) {
  make(3);  // as /dev/null
  if (IsSkipped()) return;
  check_writable(device_);
  write_file_atomically(device_, "x");
  expect_device();
}

TEST_F(DeviceTest, ThatIsFullIsAnError) {
  make(7);  // as /dev/full
  if (IsSkipped()) return;
  expect_error(ErrorKind::kIo, {"device", "No space left"},
               [&] { write_file_atomically(device_, "x"); });
  expect_device();
}

TEST(AtomicFile, WritesToStandardOutputByAnyOfItsNames) {
  const TemporaryFolder folder;
  const auto target = folder.write("stdout", "");
  const int saved = ::dup(STDOUT_FILENO);
  const int fd = ::open(target.c_str(), O_WRONLY);
  std::fflush(stdout);
  ::dup2(fd, STDOUT_FILENO);
  std::printf("1");
  const std::array names = {fs::path("-"), fs::path("/dev/stdout"), target};
  std::array<bool, 3> recognised{};
  for (size_t i = 0; i < names.size(); ++i) {
    recognised[i] = is_stdout(names[i]);
    if (recognised[i]) write_file_atomically(names[i], std::to_string(i + 2));
  }
  const bool other = is_stdout(folder.write("other", ""));
  ::dup2(saved, STDOUT_FILENO);
  ::close(fd);
  ::close(saved);
  for (size_t i = 0; i < names.size(); ++i) EXPECT_TRUE(recognised[i]) << names[i];
  EXPECT_FALSE(other);
  EXPECT_EQ(contents(target), "1234");
}

// --- Checks before the work ---

TEST(AtomicFile, SaysWhatCannotBeWritten) {
  const TemporaryFolder folder;
  folder.write("file", "old");
  fs::create_directory(folder.path() / "folder");
  struct Row {
    const char* target;
    const char* reason;
  };
  for (const Row& row : {Row{"missing/target", "No such file"}, Row{"folder", "it is a folder"},
                         Row{"folder/", "it is a folder"}, Row{"file/target", "Not a directory"}}) {
    const fs::path target = folder.path() / row.target;
    expect_error(ErrorKind::kIo, {row.target, row.reason}, [&] { check_writable(target); });
    expect_error(ErrorKind::kIo, {row.target, row.reason},
                 [&] { write_file_atomically(target, "x"); });
  }
  expect_error(ErrorKind::kIo, {"not the name of a file"}, [] { check_writable(""); });
  EXPECT_EQ(files_in(folder.path()), 2U);
}

// Root may write everything: as somebody else, then.
TEST(AtomicFile, RefusesWhatMustNotBeWritten) {
  const TemporaryFolder folder;
  const auto file = folder.write("file", "old");
  ::chmod(file.c_str(), 0444);
  const bool root = ::geteuid() == 0;
  constexpr uid_t kNobody = 65534;
  if (root) {
    ASSERT_EQ(::chown(folder.path().c_str(), kNobody, kNobody), 0);
    ASSERT_EQ(::seteuid(kNobody), 0);
  }
  expect_error(ErrorKind::kIo, {"file", "Permission denied"}, [&] { check_writable(file); });
  expect_error(ErrorKind::kIo, {"Permission denied"}, [&] { write_file_atomically(file, "new"); });
  ::chmod(folder.path().c_str(), 0555);
  expect_error(ErrorKind::kIo, {"new", "Permission denied"},
               [&] { check_writable(folder.path() / "new"); });
  expect_error(ErrorKind::kIo, {"runs/1", "Permission denied"},
               [&] { check_folder_writable(folder.path() / "runs/1"); });
  ::chmod(folder.path().c_str(), 0755);
  if (root) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  EXPECT_EQ(contents(file), "old");
}

TEST(AtomicFile, CheckingChangesNothing) {
  const TemporaryFolder folder;
  const auto file = folder.write("file", "old");
  check_writable(file);
  check_writable(folder.path() / "new");
  check_folder_writable(folder.path());
  check_folder_writable(folder.path() / "a/b/c");
  EXPECT_EQ(contents(file), "old");
  EXPECT_EQ(files_in(folder.path()), 1U);
  expect_error(ErrorKind::kIo, {"file/a", "is not a folder"},
               [&] { check_folder_writable(file / "a"); });
  expect_error(ErrorKind::kIo, {"is not a folder"}, [&] { check_folder_writable(file); });
}

}  // namespace
}  // namespace itn
