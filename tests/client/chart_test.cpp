#include "client/chart.h"

#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "common/files/read_file.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::Pointwise;

TEST(AxisMarksTest, AreRoundAndWithinTheAxis) {
  EXPECT_THAT(axis_marks(0, 10, 5), ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(axis_marks(-0.05, 1.05, 10),
              Pointwise(DoubleNear(1e-12), {0., .1, .2, .3, .4, .5, .6, .7, .8, .9, 1.}));
  EXPECT_THAT(axis_marks(103, 977, 4), ElementsAre(200, 400, 600, 800));
  EXPECT_FALSE(std::signbit(axis_marks(-0.5, 10, 5).front()));
}

TEST(ChartTest, IsWrittenWhateverTheValuesAre) {
  const testing::TemporaryFolder folder;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Chart> charts{
      {"nothing", "steps", false, {}},
      {"no curve has a point", "steps", true, {{"a", {}, {}}, {"b", {1}, {nan}}}},
      {"one point, one value", "steps", true, {{"a", {1}, {2}}, {"b", {1, 2}, {-1, 0}}}},
      {"constant", "steps", false, {{"a", {1, 2, 3}, {5, 5, 5}}, {"b", {1, 2}, {0, 1e30}}}},
  };
  const std::filesystem::path path = folder.path() / "chart.png";
  write_charts(path, charts);
  EXPECT_GT(std::filesystem::file_size(path), 4000U);
}

// Thirteen names do not fit into one line.
TEST(ChartTest, ALongLegendHasItsLines) {
  const testing::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "chart.png";
  const auto height_with = [&](int curves) {
    Chart chart{"title", "steps", false, {}};
    for (int i = 0; i < curves; ++i) {
      chart.curves.push_back({"a network of " + std::to_string(10 + i), {0, 1}, {0, 1.0 + i}});
    }
    write_charts(path, std::vector{chart});
    const std::string png = read_file(path, "picture");
    int height = 0;  // PNG's second number, big-endian
    for (int k = 20; k < 24; ++k) height = 256 * height + static_cast<unsigned char>(png.at(k));
    return height;
  };
  EXPECT_EQ(height_with(3), 360);
  EXPECT_GT(height_with(13), 360 + 20);
}

}  // namespace
}  // namespace itn
