#include "client/image/preview.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

namespace itn {
namespace {

// IEC 61966-2-1: middle grey of 18 % is 118, the ends stay.
TEST(Preview, IsSrgb) {
  EXPECT_EQ(to_srgb_byte(0), 0);
  EXPECT_EQ(to_srgb_byte(0.18F), 118);
  EXPECT_EQ(to_srgb_byte(0.5F), 188);
  EXPECT_EQ(to_srgb_byte(1), 255);
  EXPECT_EQ(to_srgb_byte(-1), 0);
  EXPECT_EQ(to_srgb_byte(std::numeric_limits<float>::infinity()), 255);
}

TEST(Preview, WhiteLeavesOutTheBrightestHundredth) {
  std::vector<float> values(200, 2);
  values[17] = 1000;
  EXPECT_EQ(white_level(values), 2);
  EXPECT_EQ(white_level({0, 0}), 1);
}

}  // namespace
}  // namespace itn
