#include "client/files/folder_lock.h"

#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <fstream>
#include <memory>
#include <optional>

#include <gmock/gmock.h>

#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using namespace testing;

TEST(FolderLock, NamesTheProcessThatHoldsIt) {
  const TemporaryFolder folder;
  const fs::path path = folder.path("run");
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  {
    const FolderLock lock(path, "itn train");
    expect_error(ErrorKind::kIo,
                 {path.string() + " is in use by process " + std::to_string(getpid()) + " on " +
                  host.data() + " (itn train)"},
                 [&] { const FolderLock second(path, "itn train"); });
    // A lock that is refused leaves the file to its holder.
    EXPECT_TRUE(fs::exists(path / FolderLock::kName));
  }
  const FolderLock again(path, "itn train");
}

TEST(FolderLock, LeavesNothingBehind) {
  const TemporaryFolder folder;
  { const FolderLock lock(folder.path("new/run"), "a test"); }
  EXPECT_FALSE(fs::exists(folder.path("new/run")));
  fs::create_directories(folder.path("there"));
  { const FolderLock lock(folder.path("there"), "a test"); }
  EXPECT_TRUE(fs::is_empty(folder.path("there")));
  {
    const FolderLock lock(folder.path("used"), "a test");
    std::ofstream(folder.path("used/result")) << "1";
  }
  EXPECT_TRUE(fs::exists(folder.path("used/result")));
}

// The holder is killed; its file stays and holds nobody up.
TEST(FolderLock, OfAKilledProcessIsTakenOver) {
  const TemporaryFolder folder;
  const fs::path path = folder.path("run");
  std::array<int, 2> ready{};
  ASSERT_EQ(pipe(ready.data()), 0);
  const pid_t child = fork();
  if (child == 0) {
    const FolderLock lock(path, "a child");
    if (write(ready[1], "x", 1) == 1) pause();
    _exit(0);
  }
  char byte = 0;
  ASSERT_EQ(read(ready[0], &byte, 1), 1);
  expect_error(ErrorKind::kIo, {"process " + std::to_string(child), "a child"},
               [&] { const FolderLock lock(path, "a test"); });
  kill(child, SIGKILL);
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(fs::exists(path / FolderLock::kName));
  const FolderLock lock(path, "a test");
  close(ready[0]);
  close(ready[1]);
}

// Somebody has removed the file of the first one, so that a second could lock another.
TEST(FolderLock, LeavesTheFileOfAnotherLock) {
  const TemporaryFolder folder;
  const fs::path file = fs::path(folder.path("run")) / FolderLock::kName;
  auto first = std::make_unique<FolderLock>(folder.path("run"), "the first");
  fs::remove(file);
  const FolderLock second(folder.path("run"), "the second");
  first.reset();
  EXPECT_TRUE(fs::exists(file));
  expect_error(ErrorKind::kIo, {"the second"},
               [&] { const FolderLock third(folder.path("run"), "the third"); });
}

TEST(FolderLock, RemovesWhatWasBegunToBeWritten) {
  const TemporaryFolder folder;
  const fs::path path = folder.path("run");
  fs::create_directories(path / "images");
  for (const char* name : {"a.tmp", "kept", "images/b.tmp"}) std::ofstream(path / name) << "x";
  const FolderLock lock(path, "a test");
  lock.remove_temporary_files();
  EXPECT_FALSE(fs::exists(path / "a.tmp"));
  EXPECT_TRUE(fs::exists(path / "images/b.tmp"));
  lock.remove_temporary_files("images");
  EXPECT_FALSE(fs::exists(path / "images/b.tmp"));
  EXPECT_TRUE(fs::exists(path / "kept"));
}

TEST(FolderLock, SaysWhyItCannotBeTaken) {
  const TemporaryFolder folder;
  std::ofstream(folder.path("file")) << "x";
  expect_error(ErrorKind::kIo, {"cannot create", "file/run"},
               [&] { const FolderLock lock(folder.path("file/run"), "a test"); });
}

}  // namespace
}  // namespace itn
