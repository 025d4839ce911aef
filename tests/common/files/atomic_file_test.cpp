#include "common/files/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <iterator>
#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using testing::expect_error;
using testing::TemporaryFolder;

std::string contents(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

size_t files_in(const std::filesystem::path& folder) {
  return static_cast<size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
}

TEST(AtomicFile, TargetChangesOnCommitOnly) {
  const TemporaryFolder folder;
  const auto target = folder.write("target", "old");
  AtomicFile file(target);
  std::ofstream(file.temporary()) << "new";
  EXPECT_EQ(contents(target), "old");
  file.commit();
  EXPECT_EQ(contents(target), "new");
  EXPECT_EQ(files_in(folder.path()), 1);
}

TEST(AtomicFile, LeavesNothingBehindWithoutCommit) {
  const TemporaryFolder folder;
  const auto target = folder.write("target", "old");
  { const AtomicFile file(target); }
  EXPECT_EQ(contents(target), "old");
  EXPECT_EQ(files_in(folder.path()), 1);
}

TEST(AtomicFile, TwoWritersOfOneTargetDoNotMeet) {
  const TemporaryFolder folder;
  AtomicFile a(folder.path() / "target"), b(folder.path() / "target");
  EXPECT_NE(a.temporary(), b.temporary());
}

TEST(AtomicFile, HasThePermissionsThatTheUmaskLeaves) {
  const TemporaryFolder folder;
  const mode_t before = ::umask(027);
  write_file_atomically(folder.path() / "target", "x");
  ::umask(before);
  struct stat status {};
  ASSERT_EQ(::stat((folder.path() / "target").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0640U);
}

TEST(AtomicFile, WritesBytesAsTheyAre) {
  const TemporaryFolder folder;
  const std::string bytes("a\0\r\n\xff", 5);
  write_file_atomically(folder.path() / "target", bytes);
  EXPECT_EQ(contents(folder.path() / "target"), bytes);
}

TEST(AtomicFile, SaysWhatCannotBeWritten) {
  const TemporaryFolder folder;
  expect_error(ErrorKind::kIo, {"missing/target", "No such file"},
               [&] { write_file_atomically(folder.path() / "missing" / "target", "x"); });
}

}  // namespace
}  // namespace itn
