#include "client/training/augmentation.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "common/error.h"

namespace itn {
namespace {

constexpr int64_t kImages = 200;
constexpr int64_t kSize = 16;

// A bright rectangle off the middle, brighter to the right, with a frame of 4 pixels around it.
ImageBatch images(double noise) {
  ImageBatch batch{.luminance = torch::zeros({kImages, kSize, kSize}),
                   .mask = torch::zeros({kImages, kSize, kSize}),
                   .weight = torch::zeros({kImages, kSize, kSize}),
                   .noise = torch::full({kImages, kSize, kSize}, noise)};
  const torch::Tensor ramp = torch::arange(1, 8).to(torch::kFloat32);
  batch.luminance.narrow(1, 4, 8).narrow(2, 4, 7).copy_(ramp.view({1, 1, 7}));
  batch.weight.copy_(batch.luminance);
  batch.mask.narrow(1, 4, 8).narrow(2, 4, 7).fill_(1);
  return batch;
}

v1::Augmentation noise_of(double min, double max) {
  v1::Augmentation augmentation;
  augmentation.mutable_noise()->set_min(min);
  augmentation.mutable_noise()->set_max(max);
  return augmentation;
}

// Relative noise of image i, over its object.
double noise_in(const ImageBatch& noisy, const ImageBatch& quiet, int64_t i) {
  const torch::Tensor object = quiet.mask[i] > 0.5;
  const torch::Tensor ratio =
      noisy.luminance[i].masked_select(object) / quiet.luminance[i].masked_select(object) - 1;
  return ratio.square().mean().sqrt().item<double>();
}

TEST(AugmentationTest, WithoutAnyChoiceImagesStayAsTheyAre) {
  const ImageBatch batch = images(0.1);
  const ImageBatch same = augmented(batch, v1::Augmentation(), 1);
  EXPECT_TRUE(same.luminance.equal(batch.luminance));
  EXPECT_TRUE(same.mask.equal(batch.mask));
  EXPECT_TRUE(same.noise.equal(batch.noise));
}

TEST(AugmentationTest, IsAFunctionOfTheSeed) {
  v1::Augmentation all = noise_of(0.1, 0.2);
  all.set_mirror(true);
  all.set_shift(3);
  all.set_exposure(0.5);
  const ImageBatch batch = images(0.05);
  const ImageBatch a = augmented(batch, all, 1), b = augmented(batch, all, 1),
                   c = augmented(batch, all, 2);
  EXPECT_TRUE(a.luminance.equal(b.luminance));
  EXPECT_TRUE(a.mask.equal(b.mask));
  EXPECT_FALSE(a.luminance.equal(c.luminance));
  EXPECT_TRUE(batch.luminance.equal(images(0.05).luminance)) << "the images given were changed";
}

TEST(AugmentationTest, MirrorsEverySecondImageAndItsMask) {
  v1::Augmentation augmentation;
  augmentation.set_mirror(true);
  const ImageBatch batch = images(0);
  const ImageBatch result = augmented(batch, augmentation, 3);
  int mirrored = 0;
  for (int64_t i = 0; i < kImages; ++i) {
    if (!result.luminance[i].equal(batch.luminance[i])) {
      ++mirrored;
      EXPECT_TRUE(result.luminance[i].equal(batch.luminance[i].flip(-1)));
      EXPECT_TRUE(result.mask[i].equal(batch.mask[i].flip(-1)));
      EXPECT_TRUE(result.weight[i].equal(batch.weight[i].flip(-1)));
    }
  }
  // Six standard deviations of a binomial distribution.
  EXPECT_NEAR(mirrored, kImages / 2, 6 * std::sqrt(kImages / 4.0));
}

TEST(AugmentationTest, ShiftsImageAndMaskTogetherByAnyOffset) {
  v1::Augmentation augmentation;
  augmentation.set_shift(3);
  const ImageBatch batch = images(0);
  const ImageBatch result = augmented(batch, augmentation, 4);
  std::set<std::pair<int64_t, int64_t>> offsets;
  for (int64_t i = 0; i < kImages; ++i) {
    // Nothing leaves a frame of 4 pixels.
    EXPECT_FLOAT_EQ(result.mask[i].sum().item<float>(), batch.mask[i].sum().item<float>());
    EXPECT_TRUE((result.luminance[i] > 0).equal(result.mask[i] > 0));
    EXPECT_TRUE(result.weight[i].equal(result.luminance[i]));
    const torch::Tensor corner = result.mask[i].nonzero()[0];
    offsets.emplace(corner[0].item<int64_t>() - 4, corner[1].item<int64_t>() - 4);
  }
  for (const auto& [dy, dx] : offsets) {
    EXPECT_LE(std::abs(dx), 3);
    EXPECT_LE(std::abs(dy), 3);
  }
  EXPECT_GE(offsets.size(), 40U);  // of 49; 200 draws miss one with probability 1.6 % each
}

TEST(AugmentationTest, WhatIsShiftedOutIsLostAndWhatComesInIsBlack) {
  v1::Augmentation augmentation;
  augmentation.set_shift(20);  // more than the image
  ImageBatch batch = images(0);
  batch.mask.fill_(1);
  const ImageBatch result = augmented(batch, augmentation, 5);
  for (int64_t i = 0; i < kImages; ++i) {
    EXPECT_LE(result.mask[i].sum().item<float>(), batch.mask[i].sum().item<float>());
  }
}

TEST(AugmentationTest, BringsTheNoiseToALevelThatTellsNothing) {
  for (const double own : {0.0, 0.08, 0.11}) {
    const ImageBatch quiet = images(own);
    const ImageBatch noisy = augmented(quiet, noise_of(0.12, 0.12), 6);
    double squares = 0;
    for (int64_t i = 0; i < kImages; ++i) {
      EXPECT_TRUE((noisy.noise[i] == 0.12F).all().item<bool>());
      squares += std::pow(noise_in(noisy, quiet, i), 2);
    }
    // 200 images of 56 pixels: the mean square is known to 1.3 %; five standard errors.
    const double added = squares / kImages, expected = 0.12 * 0.12 - own * own;
    EXPECT_NEAR(added / expected, 1, 0.07) << "own noise " << own;
  }
}

// To each pixel what it misses: a part of the image that is noisier by itself gets less.
TEST(AugmentationTest, BringsEachPixelToTheLevel) {
  ImageBatch quiet = images(0.05);
  quiet.noise.narrow(1, 8, 8).fill_(0.1);  // the lower half
  const ImageBatch noisy = augmented(quiet, noise_of(0.12, 0.12), 6);
  const auto added = [&](int64_t row) {
    const auto part = [&](const torch::Tensor& t) { return t.narrow(1, row, 4).narrow(2, 4, 7); };
    return (part(noisy.luminance) / part(quiet.luminance) - 1).square().mean().item<double>();
  };
  // 5,600 pixels each: known to 1.9 %; five standard errors.
  EXPECT_NEAR(added(4) / (0.12 * 0.12 - 0.05 * 0.05), 1, 0.1);
  EXPECT_NEAR(added(8) / (0.12 * 0.12 - 0.1 * 0.1), 1, 0.1);
}

// Noise moves with its pixels.
TEST(AugmentationTest, MovesTheNoiseWithTheImage) {
  ImageBatch batch = images(0);
  batch.noise = batch.luminance.clone();
  v1::Augmentation moves;
  moves.set_mirror(true);
  moves.set_shift(3);
  const ImageBatch moved = augmented(batch, moves, 3);
  EXPECT_TRUE(moved.noise.equal(moved.luminance));
  EXPECT_FALSE(moved.noise.equal(batch.noise));
}

TEST(AugmentationTest, DrawsTheLevelFromItsRangeAndLeavesNoisierImages) {
  const ImageBatch quiet = images(0);
  const ImageBatch noisy = augmented(quiet, noise_of(0.05, 0.15), 7);
  const torch::Tensor levels = noisy.noise.amax({1, 2});
  EXPECT_TRUE(levels.equal(noisy.noise.amin({1, 2}))) << "one for each image";
  EXPECT_NEAR(levels.mean().item<double>(), 0.1, 6 * 0.1 / std::sqrt(12 * kImages));
  EXPECT_GE(noisy.noise.min().item<double>(), 0.05 - 1e-6);
  EXPECT_LE(noisy.noise.max().item<double>(), 0.15 + 1e-6);
  const ImageBatch loud = images(0.3);
  const ImageBatch same = augmented(loud, noise_of(0.05, 0.15), 7);
  EXPECT_TRUE(same.luminance.equal(loud.luminance));
  EXPECT_TRUE(same.noise.equal(loud.noise));
}

// Renders in colour have noise that is alike as their media are.
TEST(AugmentationTest, NoiseOfColoursHasAnyCorrelation) {
  constexpr int64_t kSide = 64, kColours = 3;
  constexpr double kLevel = 0.1;
  const torch::Tensor one = torch::ones({kImages * kColours, kSide, kSide});
  const ImageBatch flat{.luminance = one,
                        .mask = one,
                        .weight = {},
                        .noise = torch::zeros_like(one),
                        .channels = kColours};
  const torch::Tensor noise =
      (augmented(flat, noise_of(kLevel, kLevel), 1).luminance - 1).view({kImages, kColours, -1});
  EXPECT_NEAR(noise.square().mean().sqrt().item<double>(), kLevel, 0.01 * kLevel);
  std::vector<double> correlations;
  for (int64_t i = 0; i < kImages; ++i) {
    correlations.push_back((noise[i][0] * noise[i][2]).mean().item<double>() / (kLevel * kLevel));
  }
  std::ranges::sort(correlations);
  // Uniform: of 200 the least deviation of the distribution that one in 1,000 has is .138.
  for (size_t i = 0; i < correlations.size(); ++i) {
    EXPECT_NEAR(correlations[i], (static_cast<double>(i) + 0.5) / kImages, 0.14);
  }
}

// Images that are black, whose noise is 0, and that are nothing but noise.
TEST(AugmentationTest, NoiseLeavesNoNumberThatIsNone) {
  ImageBatch black = images(0);
  black.luminance.fill_(0);
  const ImageBatch still_black = augmented(black, noise_of(0.1, 0.1), 9);
  EXPECT_TRUE(still_black.luminance.equal(black.luminance));
  const ImageBatch noise = images(HUGE_VAL);
  const ImageBatch same = augmented(noise, noise_of(0.1, 0.1), 9);
  EXPECT_TRUE(same.luminance.equal(noise.luminance));
  EXPECT_TRUE(same.noise.equal(noise.noise));
}

TEST(AugmentationTest, ExposureIsOneFactorForEachImage) {
  v1::Augmentation augmentation;
  augmentation.set_exposure(0.5);
  const ImageBatch batch = images(0);
  const ImageBatch result = augmented(batch, augmentation, 8);
  double sum = 0, squares = 0;
  for (int64_t i = 0; i < kImages; ++i) {
    EXPECT_NEAR(noise_in(result, result, i), 0, 1e-6);
    const double factor = (result.luminance[i].sum() / batch.luminance[i].sum()).item<double>();
    EXPECT_TRUE(result.luminance[i].allclose(batch.luminance[i] * factor));
    sum += std::log(factor);
    squares += std::pow(std::log(factor), 2);
  }
  EXPECT_NEAR(sum / kImages, 0, 5 * 0.5 / std::sqrt(kImages));
  EXPECT_NEAR(std::sqrt(squares / kImages), 0.5, 5 * 0.5 / std::sqrt(2 * kImages));
}

TEST(AugmentationTest, RefusesWhatMakesNoSense) {
  EXPECT_NO_THROW(validate(noise_of(0.1, 0.1)));
  EXPECT_THROW(validate(noise_of(0.2, 0.1)), Error);
  EXPECT_THROW(validate(noise_of(-0.1, 0.1)), Error);
  EXPECT_THROW(validate(noise_of(0, std::nan(""))), Error);
  v1::Augmentation augmentation;
  augmentation.set_exposure(-1);
  EXPECT_THROW(validate(augmentation), Error);
  augmentation.set_exposure(0);
  augmentation.set_shift(65);
  EXPECT_THROW(validate(augmentation), Error);
}

}  // namespace
}  // namespace itn
