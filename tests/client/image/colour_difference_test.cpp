#include "client/image/colour_difference.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace itn {
namespace {

TEST(ColourDifference, BlackAndWhiteAreAHundredApart) {
  EXPECT_NEAR(colour_difference({0, 0, 0}, {1, 1, 1}), 100, 0.01);
  EXPECT_EQ(colour_difference({0.3, 0.5, 0.2}, {0.3, 0.5, 0.2}), 0);
}

// Grays have no chroma, so that the formula is that of lightness alone: L* is 50 and 53.
TEST(ColourDifference, OfGraysIsThatOfLightness) {
  const auto gray = [](double lightness) {
    const double y = (lightness + 16) / 116;
    return std::array<double, 3>{y * y * y, y * y * y, y * y * y};
  };
  const double mean = 51.5 - 50;
  const double weight = 1 + 0.015 * mean * mean / std::sqrt(20 + mean * mean);
  EXPECT_NEAR(colour_difference(gray(50), gray(53)), 3 / weight, 2e-3);
}

// A pair of Sharma, Wu and Dalal, "The CIEDE2000 color-difference formula: implementation notes,
// supplementary test data, and mathematical observations", 2005, Table 1 (the first): Lab of
// (50, 2.6772, -79.7751) and (50, 0, -82.7485) are 2.0425 apart.
TEST(ColourDifference, AgreesWithPublishedData) {
  // Lab to linear sRGB, of any values: some are outside of what screens show.
  const auto rgb = [](double l, double a, double b) {
    const auto cube = [](double t) {
      return t > 6.0 / 29 ? t * t * t : 3 * 36.0 / 841 * (t - 4.0 / 29);
    };
    const double y = (l + 16) / 116;
    const double x = 0.9505 * cube(y + a / 500), z = 1.0890 * cube(y - b / 200);
    const double luminance = cube(y);
    return std::array<double, 3>{3.2406 * x - 1.5372 * luminance - 0.4986 * z,
                                 -0.9689 * x + 1.8758 * luminance + 0.0415 * z,
                                 0.0557 * x - 0.2040 * luminance + 1.0570 * z};
  };
  EXPECT_NEAR(colour_difference(rgb(50, 2.6772, -79.7751), rgb(50, 0, -82.7485)), 2.0425, 0.02);
  EXPECT_NEAR(colour_difference(rgb(50, 2.5, 0), rgb(73, 25, -18)), 27.1492, 0.02);
  EXPECT_NEAR(colour_difference(rgb(60.2574, -34.0099, 36.2677), rgb(60.4626, -34.1751, 39.4387)),
              1.2644, 0.01);
}

}  // namespace
}  // namespace itn
