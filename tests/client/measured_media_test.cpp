#include "client/measured_media.h"

#include <gtest/gtest.h>

#include <set>

#include "common/error.h"

namespace itn {
namespace {

TEST(MeasuredMedia, AreMaterialsThatCanBeRendered) {
  std::set<std::string> names;
  for (const MeasuredMedium& medium : measured_media()) {
    EXPECT_TRUE(names.insert(medium.name).second) << medium.name;
    EXPECT_GE(medium.index, 1.3);
    for (size_t channel = 0; channel < 3; ++channel) {
      const Material material = medium.material(channel);
      EXPECT_NO_THROW(validate(material)) << medium.name;
      EXPECT_NEAR(material.sigma_a(), medium.sigma_a[channel], 1e-9) << medium.name;
    }
  }
  EXPECT_EQ(names.size(), 47U);
}

// Jensen et al., table "Measured parameters", and Narasimhan et al., table of milks.
TEST(MeasuredMedia, HaveThePublishedFigures) {
  const MeasuredMedium& marble = measured_medium("marble");
  EXPECT_DOUBLE_EQ(marble.sigma_s[0], 2.19);
  EXPECT_DOUBLE_EQ(marble.sigma_a[2], 0.0071);
  EXPECT_DOUBLE_EQ(marble.index, 1.5);
  EXPECT_DOUBLE_EQ(marble.material(1).sigma_t, 2.62 + 0.0041);
  EXPECT_EQ(marble.material(1).g, 0);
  EXPECT_GT(measured_medium("regular_milk").material(0).g, 0.7);
}

TEST(MeasuredMedia, OthersAreRefused) {
  EXPECT_THROW(measured_medium("granite"), Error);
}

}  // namespace
}  // namespace itn
