#include "client/exports/rgb_material.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

const std::vector<Material> kJade{{40, .9, .6}, {70, .95, .3}, {25, .5, -.2}};

TEST(RgbMaterial, OfOneChannelIsThatChannelThreeTimes) {
  const RgbMaterial material = rgb_material(std::vector<Material>{{40, .9, .6}});
  EXPECT_TRUE(material.gray);
  EXPECT_DOUBLE_EQ(material.g, .6);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_DOUBLE_EQ(material.sigma_t(c), 40);
    EXPECT_DOUBLE_EQ(material.albedo(c), .9);
    EXPECT_DOUBLE_EQ(material.mean_free_path(c), .025);
  }
}

TEST(RgbMaterial, KeepsAbsorptionAndReducedScatteringOfEachChannel) {
  const RgbMaterial material = rgb_material(kJade);
  EXPECT_FALSE(material.gray);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_DOUBLE_EQ(material.sigma_a[c], kJade[c].sigma_a());
    EXPECT_DOUBLE_EQ(material.sigma_s_reduced(c), kJade[c].sigma_s_reduced());
  }
}

TEST(RgbMaterial, KeepsTheSumOfScattering) {
  const RgbMaterial material = rgb_material(kJade);
  double before = 0, after = 0;
  for (size_t c = 0; c < 3; ++c) {
    before += kJade[c].sigma_s();
    after += material.sigma_s[c];
  }
  EXPECT_NEAR(after, before, 1e-12 * before);
}

TEST(RgbMaterial, KeepsChannelsThatHaveOneG) {
  const std::vector<Material> channels{{40, .9, .6}, {70, .95, .6}, {25, .5, .6}};
  const RgbMaterial material = rgb_material(channels);
  EXPECT_NEAR(material.g, .6, 1e-15);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(material.sigma_t(c), channels[c].sigma_t, 1e-12);
    EXPECT_NEAR(material.albedo(c), channels[c].albedo, 1e-14);
  }
}

TEST(RgbMaterial, IgnoresTheGOfAChannelThatDoesNotScatter) {
  const RgbMaterial material =
      rgb_material(std::vector<Material>{{40, .9, .6}, {70, .95, .6}, {25, 0, -.9}});
  EXPECT_NEAR(material.g, .6, 1e-15);
  EXPECT_EQ(material.sigma_s[2], 0);
}

TEST(RgbMaterial, ThatOnlyAbsorbsIsAMaterial) {
  const RgbMaterial material = rgb_material(std::vector<Material>{{40, 0, .6}});
  EXPECT_EQ(material.g, 0);
  EXPECT_EQ(material.sigma_a[0], 40);
  EXPECT_EQ(material.sigma_s[0], 0);
}

// Half-spaces that scatter isotropically, under diffuse light: the exact albedo is
// 1 - 2 sqrt(1 - albedo) * (first moment of Chandrasekhar's H), S. Chandrasekhar, "Radiative
// Transfer", 1960, section 42; with H solved numerically.
double exact_diffuse_albedo(double albedo) {
  constexpr int kNodes = 400;
  std::vector<double> h(kNodes, 1);
  const double root = std::sqrt(1 - albedo);
  const auto mu = [](int i) { return (i + .5) / kNodes; };
  for (int iteration = 0; iteration < 60; ++iteration) {
    std::vector<double> next(kNodes);
    for (int i = 0; i < kNodes; ++i) {
      double sum = 0;
      for (int j = 0; j < kNodes; ++j) sum += mu(j) * h[j] / (mu(i) + mu(j));
      next[i] = 1 / (root + albedo / 2 * sum / kNodes);
    }
    h = next;
  }
  double moment = 0;
  for (int i = 0; i < kNodes; ++i) moment += mu(i) * h[i] / kNodes;
  return 1 - 2 * root * moment;
}

TEST(RgbMaterial, DiffuseAlbedoIsThatOfAHalfSpace) {
  for (const double albedo : {.3, .8, .99}) {
    const RgbMaterial material = rgb_material(std::vector<Material>{{40, albedo, 0}});
    EXPECT_NEAR(material.diffuse_albedo(0), exact_diffuse_albedo(albedo), .004) << albedo;
  }
}

TEST(RgbMaterial, DiffuseAlbedoIsOneWithoutAbsorptionAndZeroWithoutScattering) {
  EXPECT_EQ(rgb_material(std::vector<Material>{{40, 1, .3}}).diffuse_albedo(0), 1);
  EXPECT_EQ(rgb_material(std::vector<Material>{{40, 0, .3}}).diffuse_albedo(0), 0);
}

TEST(RgbMaterial, OfTwiceTheSizeHasHalfTheCoefficients) {
  const RgbMaterial material = rgb_material(kJade), larger = with_lengths_scaled(material, 2);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_DOUBLE_EQ(larger.sigma_a[c], material.sigma_a[c] / 2);
    EXPECT_DOUBLE_EQ(larger.sigma_s[c], material.sigma_s[c] / 2);
    EXPECT_DOUBLE_EQ(larger.diffuse_albedo(c), material.diffuse_albedo(c));
  }
  EXPECT_EQ(larger.g, material.g);
}

TEST(RgbMaterial, RefusesOtherNumbersOfChannelsAndWhatIsNoMaterial) {
  testing::expect_error(ErrorKind::kInvalidInput, {"2 materials", "one, or those of R, G and B"},
                        [] { rgb_material(std::vector<Material>(2)); });
  testing::expect_error(ErrorKind::kInvalidInput, {"albedo", "1.5"}, [] {
    rgb_material(std::vector<Material>{{1, 1.5, 0}});
  });
}

}  // namespace
}  // namespace itn
