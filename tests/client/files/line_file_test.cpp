#include "client/files/line_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>

#include "common/error.h"
#include "common/files/read_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;

// Files of this process have no room beyond a size, as on a disk that is full.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : ignored_(::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    ::signal(SIGXFSZ, ignored_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
  sighandler_t ignored_;
};

TEST(LineFile, GrowsByLines) {
  const TemporaryFolder folder;
  const auto path = folder.write("lines", "a\n");
  LineFile file(path);
  for (const char* line : {"b", "c"}) {
    file.add(line);
    file.flush();
  }
  EXPECT_EQ(read_file(path, "file"), "a\nb\nc\n");
}

TEST(LineFile, WritesWhatIsMissingWhenThereIsRoomAgain) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "lines";
  LineFile file(path);
  file.add("first");
  file.flush();
  for (const char* line : {"second", "third"}) {
    const FileSizeLimit limit(9);
    file.add(line);
    expect_error(ErrorKind::kIo, {path.string(), "File too large"}, [&] { file.flush(); });
    EXPECT_EQ(read_file(path, "file"), "first\nsec");
  }
  file.flush();
  EXPECT_EQ(read_file(path, "file"), "first\nsecond\nthird\n");
}

TEST(LineFile, SaysWhatCannotBeOpened) {
  expect_error(ErrorKind::kIo, {"/nowhere/lines", "No such file"},
               [] { LineFile file("/nowhere/lines"); });
}

}  // namespace
}  // namespace itn
