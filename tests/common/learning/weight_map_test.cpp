#include "common/learning/weight_map.h"

#include <cmath>
#include <random>

#include <gmock/gmock.h>

namespace itn {
namespace {

using ::testing::Each;

constexpr int kSize = 64;
constexpr float kReach = kSize / 4.0F;

struct Picture {
  std::vector<float> luminance = std::vector<float>(kSize * kSize, 1);
  std::vector<float> mask = std::vector<float>(kSize * kSize, 0);
};

// A square object of even radiance, whose outermost pixels are 8 and 55.
Picture square() {
  Picture p;
  for (int y = 8; y < 56; ++y) {
    for (int x = 8; x < 56; ++x) p.mask[y * kSize + x] = 1;
  }
  return p;
}

std::vector<float> weights(const Picture& p) {
  return weight_map(kSize, kSize, p.luminance, p.mask);
}

TEST(WeightMap, FallsLinearlyFromTheSilhouette) {
  const std::vector<float> w = weights(square());
  constexpr int kRow = 32;
  for (int x = 8; x < 32; ++x) {
    const float distance = static_cast<float>(x) - 8;
    EXPECT_NEAR(w[kRow * kSize + x], std::max(0.0F, 1 - distance / kReach), 1e-5) << x;
  }
}

TEST(WeightMap, IsZeroOffTheObjectAndInRange) {
  const Picture p = square();
  const std::vector<float> w = weights(p);
  for (size_t i = 0; i < w.size(); ++i) {
    EXPECT_GE(w[i], 0);
    EXPECT_LE(w[i], p.mask[i]);
  }
}

TEST(WeightMap, FindsAnEdgeInsideTheObject) {
  Picture p = square();
  for (int y = 0; y < kSize; ++y) {
    for (int x = 32; x < kSize; ++x) p.luminance[y * kSize + x] = 0.1F;
  }
  const std::vector<float> w = weights(p);
  EXPECT_GT(w[32 * kSize + 32], 0.85);
  EXPECT_LT(weights(square())[32 * kSize + 32], 0.01);
}

TEST(WeightMap, DoesNotDependOnTheScaleOfTheImage) {
  Picture p = square();
  std::mt19937 random(1);
  for (float& y : p.luminance) y = std::uniform_real_distribution<float>(0, 1)(random);
  const std::vector<float> w = weights(p);
  for (float& y : p.luminance) y *= 1024;
  EXPECT_EQ(weights(p), w);
}

TEST(WeightMap, IgnoresTheNoiseOfARender) {
  Picture p = square();
  std::mt19937 random(1);
  for (float& y : p.luminance) y = std::normal_distribution<float>(1, 0.05F)(random);
  EXPECT_LT(weights(p)[32 * kSize + 32], 0.01);
}

TEST(WeightMap, OfAnEmptyMaskIsZero) {
  Picture p = square();
  p.mask.assign(kSize * kSize, 0);
  EXPECT_THAT(weights(p), Each(0.0F));
}

TEST(WeightMap, OfABlackImageStillShowsTheSilhouette) {
  Picture p = square();
  p.luminance.assign(kSize * kSize, 0);
  EXPECT_EQ(weights(p)[32 * kSize + 8], 1);
}

}  // namespace
}  // namespace itn
