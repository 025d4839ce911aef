#include "client/panels.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

TEST(Panels, CompareAnImageAndARender) {
  const PanelRow panels = compared(std::vector{2.0F, 0.0F}, std::vector{2.0F, 2.0F}, 2, 1, 2);
  const Rgb white{255, 255, 255}, black{0, 0, 0}, red{255, 0, 0};
  ASSERT_EQ(panels.size(), 3U);
  EXPECT_EQ(panels[0].pixels, (std::vector{white, black, white, white}));  // the second row is none
  EXPECT_EQ(panels[1].pixels, (std::vector{white, white, white, white}));
  EXPECT_EQ(panels[2].pixels, (std::vector{white, red, white, white}));
}

}  // namespace
}  // namespace itn
