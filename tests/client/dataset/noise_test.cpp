#include "client/dataset/noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace itn {
namespace {

TEST(RelativeNoise, IsOfTheObjectAndOfTheImageWithoutIt) {
  const std::vector<float> radiance{3, 4, 100, 0}, error{0.3F, 0.4F, 50, 0}, mask{1, 0.5F, 0, 0};
  EXPECT_NEAR(relative_noise(radiance, error, mask), std::sqrt(0.25 / (25 - 0.25)), 1e-6);
  const std::vector<float> none(4);
  EXPECT_EQ(relative_noise(radiance, none, mask), 0);
  EXPECT_EQ(relative_noise(none, none, mask), 0);
  EXPECT_EQ(relative_noise(error, radiance, mask), std::numeric_limits<double>::infinity());
}

TEST(RelativeNoise, TakesAsManySamplesAsTheTargetNeeds) {
  v1::NoiseTarget target;
  target.set_target(0.05);
  target.set_pilot_spp(8);
  target.set_min_spp(4);
  target.set_max_spp(1000);
  EXPECT_EQ(spp_for(target, 0.1), 32);
  EXPECT_EQ(spp_for(target, 0.11), 39);  // 38.7
  EXPECT_EQ(spp_for(target, 0.01), 4);
  EXPECT_EQ(spp_for(target, 0), 4);
  EXPECT_EQ(spp_for(target, std::numeric_limits<double>::infinity()), 1000);
}

}  // namespace
}  // namespace itn
