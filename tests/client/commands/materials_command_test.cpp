// Measured media: itn materials, and itn render --material, as processes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;
using ::testing::HasSubstr;

TEST(MaterialsCommand, ListsMedia) {
  const Finished done = run({kItn, "materials"});
  EXPECT_EQ(done.exit_code, 0);
  EXPECT_THAT(done.output, HasSubstr("marble"));
  EXPECT_THAT(done.output, HasSubstr("Narasimhan et al. 2006"));
}

class RenderMaterial : public ::testing::Test {
 protected:
  Finished render(std::vector<std::string> flags) const {
    flags.insert(flags.begin(), {kItn, "render", source("client/examples/cube.textproto"), "-o",
                                 folder_.path("a.exr"), "--spp", "1", "--film", "8"});
    return run(flags);
  }
  TemporaryFolder folder_;
};

// The cube is 1 mm; a cube of 50 mm is 50 times as thick. Luminance is the channel G.
TEST_F(RenderMaterial, IsScaledToTheObject) {
  const Finished done = render({"--material", "marble", "--object-size", "50"});
  EXPECT_EQ(done.exit_code, 0) << done.errors;
  EXPECT_THAT(done.output, HasSubstr("sigma_t 131.2 / mm, albedo 0.99844, g 0"));
}

TEST_F(RenderMaterial, RefusesWhatDoesNotFit) {
  EXPECT_EQ(render({}).exit_code, 2);
  EXPECT_THAT(render({"--sigma-t", "3"}).errors, HasSubstr("--sigma-t and --albedo are required"));
  EXPECT_EQ(render({"--material", "marble", "--albedo", "0.5"}).exit_code, 2);
  EXPECT_EQ(render({"--sigma-t", "1", "--albedo", "0.5", "--object-size", "5"}).exit_code, 2);
  EXPECT_THAT(render({"--material", "granite"}).errors, HasSubstr("granite is no measured medium"));
}

}  // namespace
}  // namespace itn
