#include "common/learning/network_input.h"

#include <cmath>
#include <functional>
#include <vector>

#include <gtest/gtest.h>

#include "common/learning/weight_map.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {
namespace {

constexpr int kSide = 64;

v1::Model ratios(v1::Exposure exposure = v1::EXPOSURE_KNOWN, double image_scale = 1) {
  v1::Model model;
  model.set_input(v1::RATIOS);
  model.set_exposure(exposure);
  model.set_image_scale(image_scale);
  return model;
}

// A square object from 16 to 47 with a luminance by row and column, black elsewhere.
ImageBatch square(const std::function<double(int, int)>& luminance) {
  ImageBatch images{torch::zeros({1, kSide, kSide}), torch::zeros({1, kSide, kSide}), {}, {}};
  for (int y = 16; y < 48; ++y) {
    for (int x = 16; x < 48; ++x) {
      images.luminance[0][y][x] = luminance(y, x);
      images.mask[0][y][x] = 1;
    }
  }
  return images;
}

TEST(RatioInput, IsZeroOutsideOfTheObjectAndHasTheMaskLast) {
  const ImageBatch images = square([](int y, int x) { return 0.1 * y + x; });
  const torch::Tensor planes = network_input(ratios(), images);
  ASSERT_EQ(planes.sizes(), torch::IntArrayRef({1, 4, kSide, kSide}));
  EXPECT_TRUE(torch::equal(planes[0][3], images.mask[0]));
  EXPECT_EQ((planes[0] * (1 - images.mask)).abs().max().item<float>(), 0);
}

TEST(RatioInput, OfAnEvenObjectHasNoContrast) {
  const torch::Tensor planes =
      network_input(ratios(v1::EXPOSURE_KNOWN, 0.5), square([](int, int) { return 3; }))[0];
  EXPECT_NEAR(planes[0][30][30].item<float>(), std::log(1.51), 1e-5);
  // Right up to the silhouette: what is not of the object has no part in the means.
  EXPECT_LT(planes[1].abs().max().item<float>(), 1e-4);
  EXPECT_LT(planes[2].abs().max().item<float>(), 1e-5);
}

// Against the plain sums over all pixels of the object.
TEST(RatioInput, HasTheRatiosToTheLocalMeanAndTheObjectsMean) {
  const auto luminance = [](int y, int x) { return 1 + 0.5 * std::sin(0.9 * x) + 0.01 * y * y; };
  const torch::Tensor planes = network_input(ratios(), square(luminance))[0];
  constexpr double kSigma = 2;
  double object_sum = 0;
  for (int y = 16; y < 48; ++y) {
    for (int x = 16; x < 48; ++x) object_sum += luminance(y, x) / (32 * 32);
  }
  for (const auto& [py, px] : {std::pair{30, 31}, {16, 16}, {47, 20}}) {
    double sum = 0, weights = 0;
    for (int y = 16; y < 48; ++y) {
      for (int x = 16; x < 48; ++x) {
        const double w =
            std::exp(-((y - py) * (y - py) + (x - px) * (x - px)) / (2 * kSigma * kSigma));
        sum += w * luminance(y, x);
        weights += w;
      }
    }
    const double value = luminance(py, px);
    EXPECT_NEAR(planes[1][py][px].item<float>(), 4 * (value / (sum / weights) - 1), 1e-4);
    EXPECT_NEAR(planes[2][py][px].item<float>(), value / object_sum - 1, 1e-5);
  }
}

TEST(RatioInput, OfUnknownExposureDoesNotSeeTheScale) {
  const ImageBatch images = square([](int y, int x) { return 0.1 + y * x; });
  for (const double scale : {1e-9, 0.1, 1000.0}) {
    ImageBatch scaled = images;
    scaled.luminance = images.luminance * scale;
    const auto difference = [&](v1::Exposure exposure) {
      return (network_input(ratios(exposure), scaled) - network_input(ratios(exposure), images))
          .abs()
          .max()
          .item<float>();
    };
    EXPECT_LT(difference(v1::EXPOSURE_UNKNOWN), 1e-4) << scale;
    EXPECT_GT(difference(v1::EXPOSURE_KNOWN), 1) << scale;
  }
}

TEST(RatioInput, IsFiniteForEveryImage) {
  const std::function<double(int, int)> luminances[] = {
      [](int, int) { return 0; }, [](int, int) { return 1e30; },
      [](int y, int x) { return y == 20 && x == 20 ? 1e30 : 1e-30; }};
  for (const auto exposure : {v1::EXPOSURE_KNOWN, v1::EXPOSURE_UNKNOWN}) {
    for (const auto& luminance : luminances) {
      EXPECT_TRUE(network_input(ratios(exposure), square(luminance)).isfinite().all().item<bool>());
    }
  }
}

TEST(PaperInput, IsTheScaledMaskedImageAndTheWeightMap) {
  std::vector<float> luminance(16 * 16, 2), mask(16 * 16, 0);
  mask[5 * 16 + 3] = 1;
  v1::Model model;
  model.set_input(v1::LUMINANCE_AND_WEIGHT);
  model.set_image_scale(0.5);
  const torch::Tensor input =
      network_input(model, resampled(16, luminance, mask, 16, model.input()));
  EXPECT_EQ(input.sizes(), torch::IntArrayRef({1, 2, 16, 16}));
  EXPECT_EQ(input[0][0][5][3].item<float>(), 1);
  EXPECT_EQ(input[0][0].sum().item<float>(), 1);
  EXPECT_EQ(input[0][1][5][3].item<float>(), 1);
  EXPECT_EQ(input[0][1].sum().item<float>(), 1);
}

TEST(Mirrored, ExchangesLeftAndRight) {
  std::vector<float> luminance(16 * 16, 1), mask(16 * 16, 0);
  luminance[5 * 16 + 3] = 2;
  mask[5 * 16 + 4] = 1;
  ImageBatch image = resampled(16, luminance, mask, 16, v1::LUMINANCE_AND_WEIGHT);
  image.noise = image.luminance / 10;
  const ImageBatch other = mirrored(image);
  EXPECT_EQ(other.luminance[0][5][15 - 3].item<float>(), 2);
  EXPECT_EQ(other.mask[0][5][15 - 4].item<float>(), 1);
  EXPECT_EQ(other.weight[0][5][15 - 4].item<float>(), image.weight[0][5][4].item<float>());
  EXPECT_EQ(other.luminance.sum().item<float>(), image.luminance.sum().item<float>());
  EXPECT_EQ(other.noise[0][5][15 - 3].item<float>(), 0.2F);
  EXPECT_FALSE(mirrored(resampled(16, luminance, mask, 16, v1::RATIOS)).weight.defined());
}

TEST(Resampled, AveragesTheObjectAndNothingOfTheBackground) {
  std::vector<float> luminance(32 * 32, 1000), mask(32 * 32, 0);  // a bright background
  for (size_t x = 0; x < 32; ++x) {
    for (size_t y = 9; y < 32; ++y) {  // half of the second row of 2 x 2 pixels, and below
      luminance[y * 32 + x] = x % 2 == 0 ? 1.0F : 3.0F;
      mask[y * 32 + x] = 1;
    }
  }
  const ImageBatch small = resampled(32, luminance, mask, 16, v1::RATIOS);
  EXPECT_FALSE(small.weight.defined());
  EXPECT_FLOAT_EQ(small.luminance[0][10][5].item<float>(), 2);
  EXPECT_FLOAT_EQ(small.luminance[0][4][5].item<float>(), 2);
  EXPECT_FLOAT_EQ(small.mask[0][4][5].item<float>(), 0.5);
  EXPECT_EQ(small.luminance[0][3][5].item<float>(), 0);
}

// --- In colour ---

// Red, green and blue of one object.
ImageBatch coloured_square() {
  const std::vector<ImageBatch> planes{
      square([](int y, int x) { return 2 + std::sin(0.3 * x) + 0.01 * y; }),
      square([](int y, int x) { return 1 + 0.5 * std::sin(0.9 * x) + 0.02 * y; }),
      square([](int y, int x) { return 0.5 + 0.01 * x + 0.005 * y; })};
  ImageBatch image = concatenated(planes);
  image.channels = 3;
  return image;
}

TEST(ColourInput, HasThePlanesOfEachColourThenTheMask) {
  v1::Model colour = ratios();
  colour.set_channels(3);
  EXPECT_EQ(input_channels(colour), 10);
  ImageBatch two = concatenated(std::vector<ImageBatch>{coloured_square(), coloured_square()});
  EXPECT_EQ(two.size(), 2);
  two.luminance[3] *= 2;  // red of the second
  const torch::Tensor input = network_input(colour, two);
  ASSERT_EQ(input.sizes(), torch::IntArrayRef({2, 10, kSide, kSide}));
  ImageBatch planes = two;
  planes.channels = 1;
  const torch::Tensor gray = network_input(ratios(), planes);
  for (int64_t i = 0; i < 2; ++i) {
    for (int64_t c = 0; c < 3; ++c) {
      EXPECT_TRUE(
          torch::equal(input[i].slice(0, 3 * c, 3 * c + 3), gray[3 * i + c].slice(0, 0, 3)));
    }
    EXPECT_TRUE(torch::equal(input[i][9], two.mask[0]));
  }
}

// What is unknown is one exposure for all colours, whose ratios stay.
TEST(ColourInput, OfUnknownExposureDoesNotSeeTheScaleButTheColour) {
  v1::Model colour = ratios(v1::EXPOSURE_UNKNOWN);
  colour.set_channels(3);
  const ImageBatch image = coloured_square();
  ImageBatch brighter = image, redder = image;
  brighter.luminance = 7 * image.luminance;
  redder.luminance = image.luminance.clone();
  redder.luminance[0] *= 2;
  const torch::Tensor input = network_input(colour, image);
  EXPECT_LT((network_input(colour, brighter) - input).abs().max().item<float>(), 1e-5);
  EXPECT_GT((network_input(colour, redder) - input).abs().max().item<float>(), 0.2);
}

TEST(ColourInput, LuminanceIsThatOfFilms) {
  const ImageBatch image = coloured_square();
  const ImageBatch luminance = luminance_of(image);
  EXPECT_EQ(luminance.size(), 1);
  EXPECT_EQ(luminance.channels, 1);
  const auto at = [&](int64_t c) { return image.luminance[c][20][30].item<double>(); };
  EXPECT_NEAR(luminance.luminance[0][20][30].item<double>(),
              0.2126 * at(0) + 0.7152 * at(1) + 0.0722 * at(2), 1e-6);
  EXPECT_TRUE(torch::equal(luminance.mask[0], image.mask[0]));
}

TEST(ColourInput, ABlackColourOfNothingButNoiseLeavesTheRest) {
  ImageBatch image = coloured_square();
  image.noise = torch::full_like(image.luminance, 0.1F);
  image.luminance[2].fill_(0);
  image.noise[2].fill_(HUGE_VALF);
  EXPECT_NEAR(luminance_of(image).noise[0][20][30].item<double>(), 0.1, 1e-6);
}

}  // namespace
}  // namespace itn
