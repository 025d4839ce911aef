// itn shapes, as a process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <vector>

#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Finished shapes(std::vector<std::string> flags) {
  flags.insert(flags.begin(), {testing::kItn, "shapes"});
  return run(flags);
}

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(ShapesCommand, ListsThem) {
  const Finished finished = shapes({});
  EXPECT_EQ(finished.exit_code, 0);
  EXPECT_THAT(finished.output, HasSubstr("sphere"));
}

TEST(ShapesCommand, WritesRandomOnesAndContinues) {
  const TemporaryFolder folder;
  const std::string out = folder.path("new/shapes");
  Finished finished = shapes({"--random", "2", "--seed", "9", "-o", out});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("2 shapes written\n"));
  EXPECT_THAT(names_in(out), ElementsAre("random-9-0.ply", "random-9-1.ply"));
  const std::string first = content(out + "/random-9-0.ply");
  // The first ones of a larger number are the same.
  finished = shapes({"--random", "3", "--seed", "9", "-o", out});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("1 shapes written, 2 were there"));
  EXPECT_EQ(content(out + "/random-9-0.ply"), first);
  EXPECT_NE(content(out + "/random-9-1.ply"), first);
  // Shapes of another seed are others, and may lie beside them.
  ASSERT_EQ(shapes({"--random", "1", "-o", out}).exit_code, 0);
  EXPECT_NE(content(out + "/random-0-0.ply"), first);
  EXPECT_EQ(names_in(out).size(), 4U);
}

TEST(ShapesCommand, ItsFilesCanBeRendered) {
  const TemporaryFolder folder;
  ASSERT_EQ(shapes({"--random", "1", "-o", folder.path("")}).exit_code, 0);
  const std::string scene = folder.write("scene.textproto", R"(
    object { mesh { path: "random-0-0.ply" } }
    lights { sun_sky { turbidity: 3 sun_elevation_degrees: 60 sun_angular_radius_degrees: 18.75 } }
    camera { origin { y: 9.28 z: -32.8 } target { y: 0.5 } fov_degrees: 2.5 }
    film { width: 32 height: 32 })");
  const Finished finished = run({testing::kItn, "render", scene, "-o", folder.path("out.exr"),
                                 "--sigma-t", "30", "--albedo", "0.8", "--spp", "4", "--json"});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("\"invalid_samples\":0"));
}

TEST(ShapesCommand, WritesBuiltInOnes) {
  const TemporaryFolder folder;
  const Finished finished = shapes({"-o", folder.path("")});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_TRUE(fs::exists(folder.path("cube.ply")));
  EXPECT_GE(names_in(folder.path()).size(), 12U);
}

TEST(ShapesCommand, ReplacesNothing) {
  const TemporaryFolder folder;
  folder.write("random-0-0.ply", "my own");
  const Finished finished = shapes({"--random", "1", "-o", folder.path("")});
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_THAT(finished.errors, HasSubstr("random-0-0.ply is there, and is not what would be"));
  EXPECT_EQ(content(folder.path("random-0-0.ply")), "my own");
  EXPECT_EQ(names_in(folder.path()).size(), 1U);
}

struct BadFlags {
  const char* name;
  std::vector<std::string> flags;
  int exit_code;
  const char* message;
};

class BadShapesFlags : public ::testing::TestWithParam<BadFlags> {};

TEST_P(BadShapesFlags, AreRefused) {
  const TemporaryFolder folder;
  std::vector<std::string> flags;
  for (const std::string& flag : GetParam().flags) {
    flags.push_back(flag.starts_with("@") ? folder.path(flag.substr(1)) : flag);
  }
  const Finished finished = shapes(flags);
  EXPECT_EQ(finished.exit_code, GetParam().exit_code);
  EXPECT_THAT(finished.errors, HasSubstr(GetParam().message));
  EXPECT_THAT(names_in(folder.path()), IsEmpty());
}

INSTANTIATE_TEST_SUITE_P(
    Table, BadShapesFlags,
    ::testing::ValuesIn(std::vector<BadFlags>{
        {"nowhere", {"--random", "3"}, 2, "say where to"},
        {"none", {"--random", "0", "-o", "@x"}, 2, "--random"},
        {"too_many", {"--random", "10000001", "-o", "@x"}, 2, "--random"},
        {"not_a_number", {"--random", "many", "-o", "@x"}, 2, "--random"},
        {"negative_seed", {"--random", "1", "--seed", "-1", "-o", "@x"}, 2, "--shape-seed"},
        {"seed_of_nothing",
         {"--seed", "1", "-o", "@x"},
         2,
         "--shape-seed requires --random-shapes"},
        {"no_output", {"-o", "/dev/null/x"}, 4, "/dev/null"},
    }),
    [](const auto& row) { return row.param.name; });

}  // namespace
}  // namespace itn
