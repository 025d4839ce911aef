#include "client/training/noise_map.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <vector>

namespace itn {
namespace {

constexpr int kSide = 16;

// An object of this radiance and standard error in all but the first two columns.
DatasetImage image(float radiance, float standard_error) {
  constexpr size_t kPixels = kSide * kSide;
  DatasetImage image{.radiance = std::vector<float>(kPixels, radiance),
                     .mask = std::vector<float>(kPixels, 1),
                     .standard_error = std::vector<float>(kPixels, standard_error)};
  for (size_t y = 0; y < kSide; ++y) image.mask[y * kSide] = image.mask[y * kSide + 1] = 0;
  return image;
}

TEST(NoiseMap, IsStandardErrorOverRadianceOnTheObject) {
  const torch::Tensor map = noise_map(image(3, 0.3F), kSide, kSide);
  const double noise = 0.1 / std::sqrt(1 - 0.01);  // what is measured contains it
  EXPECT_EQ(map.sizes(), torch::IntArrayRef({1, kSide, kSide}));
  EXPECT_EQ(map.slice(2, 0, 2).abs().max().item<float>(), 0);
  EXPECT_TRUE(torch::allclose(map.slice(2, 2), torch::full({1, kSide, kSide - 2}, noise), 1e-4));
}

TEST(NoiseMap, OfAMeanOverFourPixelsIsHalf) {
  const torch::Tensor map = noise_map(image(3, 0.3F), kSide, kSide / 2);
  EXPECT_NEAR(map[0][4][4].item<double>(), 0.05, 2e-4);
}

// The right half is as bright and twice as noisy, the lower half twice as bright.
TEST(NoiseMap, TellsPartsApart) {
  DatasetImage parts = image(3, 0.3F);
  for (size_t p = 0; p < parts.radiance.size(); ++p) {
    if (p % kSide >= kSide / 2) parts.standard_error[p] *= 2;
    if (p / kSide >= kSide / 2) parts.radiance[p] *= 2;
  }
  const torch::Tensor map = noise_map(parts, kSide, kSide);
  EXPECT_NEAR(map[0][2][3].item<double>(), 0.1, 0.002);
  EXPECT_NEAR(map[0][2][14].item<double>(), 0.2 / std::sqrt(1 - 0.04), 0.002);
  EXPECT_NEAR(map[0][14][3].item<double>(), 0.05, 0.002);
}

// The standard errors of single pixels are too uncertain to go by.
TEST(NoiseMap, IsTheRootMeanSquareOfNeighbours) {
  DatasetImage chequered = image(3, 0.1F);
  for (size_t p = 0; p < chequered.standard_error.size(); ++p) {
    if ((p / kSide + p % kSide) % 2 == 1) chequered.standard_error[p] = 0.5F;
  }
  const torch::Tensor inside = noise_map(chequered, kSide, kSide).slice(1, 6, 10).slice(2, 7, 11);
  const double variance = (0.01 + 0.25) / 2;
  const double noise = std::sqrt(variance / (9 - variance));
  EXPECT_LT((inside - noise).abs().max().item<double>(), 0.01 * noise);
}

TEST(NoiseMap, OfAnImageThatIsDrawnLargerIsThatOfItsPixels) {
  const torch::Tensor map = noise_map(image(3, 0.3F), kSide, 2 * kSide);
  EXPECT_EQ(map.sizes(), torch::IntArrayRef({1, 2 * kSide, 2 * kSide}));
  EXPECT_NEAR(map[0][16][20].item<double>(), 0.1 / std::sqrt(1 - 0.01), 1e-4);
}

TEST(NoiseMap, OfNothingButNoiseIsInfiniteAndOfWhatNobodyKnowsZero) {
  EXPECT_EQ(noise_map(image(1, 2), kSide, kSide)[0][5][5].item<double>(),
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(noise_map(image(0, 0), kSide, kSide).abs().max().item<float>(), 0);
  DatasetImage unknown = image(1, 0);
  unknown.standard_error.clear();
  EXPECT_EQ(noise_map(unknown, kSide, kSide).abs().max().item<float>(), 0);
}

}  // namespace
}  // namespace itn
