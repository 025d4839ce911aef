#include "client/presets/presets.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

TEST(Presets, OpenWithTheirNameAndWhatTheyAre) {
  for (const std::span<const Preset> presets :
       {dataset_presets(), training_presets(), experiment_presets()}) {
    for (const Preset& preset : presets) {
      EXPECT_TRUE(preset.file.starts_with(fmt::format("# {}: ", preset.name))) << preset.name;
      EXPECT_THAT(std::string(preset.description()), ::testing::Not(::testing::HasSubstr("\n")));
      EXPECT_GT(preset.description().size(), 10U) << preset.name;
    }
  }
  EXPECT_EQ(find_preset(dataset_presets(), "flash").description(),
            "a light at the camera in a dark room");
}

TEST(Presets, OneThatIsNotThereIsToldWithThoseThatAre) {
  testing::expect_error(ErrorKind::kInvalidInput, {"\"best\"", "paper, residual"},
                        [] { find_preset(training_presets(), "best"); });
}

}  // namespace
}  // namespace itn
