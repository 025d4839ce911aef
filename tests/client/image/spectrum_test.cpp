#include "client/image/spectrum.h"

#include <gtest/gtest.h>

#include "common/luminance.h"

namespace itn {
namespace {

// CIE's illuminant A, a black body of 2856 K, has the chromaticity (0.4476, 0.4074). By the matrix
// of IEC 61966-2-1 that is (1.846, 0.826, 0.233), and light of equal energy (1.205, 0.948, 0.909).
TEST(Spectrum, ABlackBodyHasTheColourOfIlluminantA) {
  const std::array<double, 3> colour = colour_of_black_body(2856);
  EXPECT_NEAR(luminance(colour), 1, 1e-12);
  EXPECT_NEAR(colour[0] / colour[1], 1.846 / 1.205 / (0.826 / 0.948), 0.03);
  EXPECT_NEAR(colour[2] / colour[1], 0.233 / 0.909 / (0.826 / 0.948), 0.01);
}

TEST(Spectrum, HotterBodiesAreBluer) {
  double last = 0;
  for (const double kelvin : {kMinTemperature, 2700.0, 4000.0, 6500.0, 12000.0, kMaxTemperature}) {
    const std::array<double, 3> colour = colour_of_black_body(kelvin);
    EXPECT_GT(colour[2] / colour[0], last);
    last = colour[2] / colour[0];
  }
  EXPECT_EQ(colour_of_black_body(0), (std::array<double, 3>{1, 1, 1}));
}

}  // namespace
}  // namespace itn
