#include "client/files/folder_files.h"

#include <gmock/gmock.h>

#include <filesystem>

#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn::testing {
namespace {

TEST(FolderFiles, AreThoseOfTheExtensionsInOrder) {
  const TemporaryFolder folder;
  for (const char* name : {"c.ply", "a.STL", "b.txt", "stl", "d.stl.bak"}) folder.write(name, "");
  std::filesystem::create_directories(folder.path() / "e.ply");
  std::filesystem::create_directories(folder.path() / "below");
  folder.write("below/f.ply", "");
  EXPECT_THAT(files_with({".ply", ".stl"}, folder.path()),
              ::testing::ElementsAre(folder.path() / "a.STL", folder.path() / "c.ply"));
  EXPECT_THAT(files_with({".exr"}, folder.path()), ::testing::IsEmpty());
  expect_error(ErrorKind::kIo, {"cannot read", "gone"},
               [&] { files_with({".ply"}, folder.path() / "gone"); });
}

}  // namespace
}  // namespace itn::testing
