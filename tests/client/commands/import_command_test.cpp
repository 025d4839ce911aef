// itn import, as a process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "common/files/read_file.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

TEST(ImportCommand, PrintsWhatRendersTheScene) {
  const TemporaryFolder folder;
  const std::string scene = folder.path("cube.textproto");
  const Finished done = run({kItn, "import", source("client/examples/cube.xml"), "-o", scene});
  EXPECT_EQ(done.exit_code, 0) << done.errors;
  EXPECT_THAT(done.output, Not(HasSubstr("not carried over")));
  const std::string command = "itn render " + scene + " -o " + folder.path("cube.exr") +
                              " --sigma-t 12,16,20 --albedo 0.99,0.97,0.9 --g 0.4 --spp 64\n";
  EXPECT_THAT(done.output, HasSubstr("render it: " + command));
  EXPECT_THAT(read_file(scene, "scene"), StartsWith("# From cube.xml.\n# " + command));
  const Finished rendered = run({kItn, "render", scene, "-o", folder.path("cube.exr"), "--film",
                                 "16", "--spp", "1", "--sigma-t", "12", "--albedo", "0.9"});
  EXPECT_EQ(rendered.exit_code, 0) << rendered.errors;
}

TEST(ImportCommand, SaysWhatIsMissing) {
  const TemporaryFolder folder;
  const std::string output = folder.path("a.textproto");
  const auto import = [&](const std::string& input) {
    return run({kItn, "import", input, "-o", output});
  };
  EXPECT_EQ(import(folder.path("absent.xml")).exit_code, 4);
  const std::string file = folder.write("scene.xml", R"(<scene version="3.0.0">
      <shape type="ply"><string name="filename" value="absent.ply"/>
        <medium type="homogeneous" name="interior"/></shape>
      <emitter type="constant"/>
      <sensor type="perspective"><float name="fov" value="30"/></sensor></scene>)");
  const Finished done = import(file);
  EXPECT_EQ(done.exit_code, 0) << done.errors;
  EXPECT_THAT(done.errors, HasSubstr("it cannot be rendered yet"));
  EXPECT_THAT(done.errors, HasSubstr("absent.ply"));
  EXPECT_EQ(run({kItn, "import", file, "-o", file}).exit_code, 2);
  EXPECT_EQ(import(folder.write("broken.xml", "<scene")).exit_code, 3);
}

}  // namespace
}  // namespace itn
