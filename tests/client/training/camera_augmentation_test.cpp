#include "client/training/camera_augmentation.h"

#include <gmock/gmock.h>

#include <cmath>
#include <vector>

#include "client/training/augmentation.h"
#include "common/error.h"

namespace itn {
namespace {

constexpr int64_t kImages = 200;
constexpr int64_t kSize = 32;
constexpr int64_t kFrom = 8, kSide = 16;  // of the object, a square

torch::Tensor inside(const torch::Tensor& images) {
  return images.narrow(1, kFrom, kSide).narrow(2, kFrom, kSide);
}

// Square objects, brighter to the right, on nothing.
ImageBatch images(double noise = 0.1) {
  ImageBatch batch{.luminance = torch::zeros({kImages, kSize, kSize}),
                   .mask = torch::zeros({kImages, kSize, kSize}),
                   .weight = {},
                   .noise = torch::zeros({kImages, kSize, kSize})};
  inside(batch.luminance).copy_(torch::arange(1, kSide + 1).to(torch::kFloat32).view({1, 1, -1}));
  inside(batch.mask).fill_(1);
  inside(batch.noise).fill_(noise);
  return batch;
}

ImageBatch uniform_images() {
  ImageBatch batch = images();
  inside(batch.luminance).fill_(2);
  return batch;
}

struct Moments {
  double mean, standard_deviation;
};

Moments moments(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double v : values) {
    sum += v;
    squares += v * v;
  }
  const double mean = sum / static_cast<double>(values.size());
  return {mean, std::sqrt(squares / static_cast<double>(values.size()) - mean * mean)};
}

// That they are uniform in [0, most]: mean and standard deviation, within five standard errors.
void expect_uniform(const std::vector<double>& values, double most) {
  const auto [mean, deviation] = moments(values);
  const double sd = most / std::sqrt(12.0), n = static_cast<double>(values.size());
  EXPECT_NEAR(mean, most / 2, 5 * sd / std::sqrt(n));
  EXPECT_NEAR(deviation, sd, 5 * sd * std::sqrt(0.2 / n));  // kurtosis 1.8
}

double at(const torch::Tensor& images, int64_t i, int64_t y, int64_t x) {
  return images[i][y][x].item<double>();
}

TEST(CameraAugmentationTest, WithoutAnyDefectImagesStayAsTheyAre) {
  const ImageBatch batch = images();
  v1::CameraAugmentation camera;
  EXPECT_FALSE(changes_images(camera));
  EXPECT_TRUE(with_camera_effects(batch, camera, 1).luminance.equal(batch.luminance));
  camera = default_camera_augmentation();
  EXPECT_TRUE(changes_images(camera));
  camera.set_share(0);
  EXPECT_FALSE(changes_images(camera));
  EXPECT_TRUE(with_camera_effects(batch, camera, 1).luminance.equal(batch.luminance));
}

TEST(CameraAugmentationTest, IsAFunctionOfTheSeed) {
  const ImageBatch batch = images();
  const ImageBatch a = with_camera_effects(batch, default_camera_augmentation(), 1),
                   b = with_camera_effects(batch, default_camera_augmentation(), 1),
                   c = with_camera_effects(batch, default_camera_augmentation(), 2);
  EXPECT_TRUE(a.luminance.equal(b.luminance));
  EXPECT_TRUE(a.mask.equal(b.mask));
  EXPECT_TRUE(a.noise.equal(b.noise));
  EXPECT_FALSE(a.luminance.equal(c.luminance));
  EXPECT_FALSE(a.mask.equal(c.mask));
  EXPECT_TRUE(batch.luminance.equal(images().luminance)) << "the images given were changed";
}

TEST(CameraAugmentationTest, OnlyTheShareIsChanged) {
  v1::CameraAugmentation camera = default_camera_augmentation();
  camera.set_share(0.3);
  const ImageBatch batch = images();
  const ImageBatch result = with_camera_effects(batch, camera, 3);
  int changed = 0;
  for (int64_t i = 0; i < kImages; ++i) {
    if (result.luminance[i].equal(batch.luminance[i])) {
      EXPECT_TRUE(result.mask[i].equal(batch.mask[i]));
      EXPECT_TRUE(result.noise[i].equal(batch.noise[i]));
    } else {
      ++changed;
    }
  }
  EXPECT_NEAR(changed, 0.3 * kImages, 5 * std::sqrt(0.21 * kImages));
}

TEST(CameraAugmentationTest, ContrastIsAPowerThatLeavesTheMeanWhereItWas) {
  v1::CameraAugmentation camera;
  camera.set_contrast(0.2);
  const ImageBatch batch = images();
  const ImageBatch result = with_camera_effects(batch, camera, 4);
  std::vector<double> logarithms;
  for (int64_t i = 0; i < kImages; ++i) {
    const double c =
        std::log(at(result.luminance, i, 9, 23) / at(result.luminance, i, 9, 8)) / std::log(16.0);
    logarithms.push_back(std::log(c));
    // What is as bright as the mean, 8.5, stays.
    EXPECT_NEAR(at(result.luminance, i, 9, 15), 8.5 * std::pow(8 / 8.5, c), 1e-3);
    EXPECT_NEAR(at(result.noise, i, 9, 12), 0.1 * c, 1e-5);
  }
  const auto [mean, deviation] = moments(logarithms);
  EXPECT_NEAR(mean, 0, 5 * 0.2 / std::sqrt(kImages));
  EXPECT_NEAR(deviation, 0.2, 5 * 0.2 / std::sqrt(2 * kImages));
}

TEST(CameraAugmentationTest, AShoulderCompressesHighlights) {
  v1::CameraAugmentation camera;
  camera.set_shoulder(2);
  const ImageBatch batch = images();
  const ImageBatch result = with_camera_effects(batch, camera, 5);
  std::vector<double> strengths;
  for (int64_t i = 0; i < kImages; ++i) {
    // With Y = y (1 + s) / (1 + s y) for y = a and y = b, s follows from the ratio of both.
    const double a = 1 / 8.5, b = 16 / 8.5;
    const double ratio = at(result.luminance, i, 9, 8) / at(result.luminance, i, 9, 23);
    const double s = (ratio * b - a) / (a * b * (1 - ratio));
    strengths.push_back(s);
    EXPECT_NEAR(at(result.luminance, i, 9, 15), 8 * (1 + s) / (1 + s * 8 / 8.5), 1e-3);
    EXPECT_NEAR(at(result.noise, i, 9, 15), 0.1 / (1 + s * 8 / 8.5), 1e-4);
  }
  expect_uniform(strengths, 2);
}

TEST(CameraAugmentationTest, VignettingDarkensTowardsTheCorners) {
  v1::CameraAugmentation camera;
  camera.set_vignetting(0.5);
  const ImageBatch batch = uniform_images();
  const ImageBatch result = with_camera_effects(batch, camera, 6);
  const double r2 = std::pow(7.5 / 16, 2);  // of the object's corners, pixels off the middle
  std::vector<double> strengths;
  for (int64_t i = 0; i < kImages; ++i) {
    const double v = (std::sqrt(2 / at(result.luminance, i, 8, 8)) - 1) / r2;
    strengths.push_back(v);
    EXPECT_NEAR(at(result.luminance, i, 15, 16), 2, 0.01);
    EXPECT_NEAR(at(result.luminance, i, 8, 23), at(result.luminance, i, 8, 8), 1e-5);
    EXPECT_NEAR(at(result.luminance, i, 16, 23),
                2 / std::pow(1 + v * (std::pow(7.5 / 16, 2) + std::pow(0.5 / 16, 2)) / 2, 2), 1e-3);
  }
  expect_uniform(strengths, 0.5);
  EXPECT_TRUE(result.noise.allclose(batch.noise));
}

// A bright point inside of an object: its width is that of the Gaussian.
TEST(CameraAugmentationTest, BlurIsAGaussian) {
  v1::CameraAugmentation camera;
  camera.set_blur(1.5);
  ImageBatch batch = images();
  batch.mask.fill_(1);
  batch.luminance.fill_(0);
  batch.luminance.select(1, 16).select(1, 16).fill_(1);
  batch.noise.fill_(0.1);
  const ImageBatch result = with_camera_effects(batch, camera, 7);
  const torch::Tensor distance = torch::arange(kSize, torch::kFloat32) - 16;
  std::vector<double> deviations;
  for (int64_t i = 0; i < kImages; ++i) {
    const torch::Tensor row = result.luminance[i].sum(0);
    EXPECT_NEAR(row.sum().item<double>(), 1, 1e-4);
    const double width = std::sqrt((row * distance.square()).sum().item<double>());
    const double column =
        std::sqrt((result.luminance[i].sum(1) * distance.square()).sum().item<double>());
    EXPECT_NEAR(width, column, 1e-3);
    // One pixel lit neighbours: no noise is lost by its mean with darkness.
    EXPECT_NEAR(at(result.noise, i, 16, 16), 0.1, 1e-4);
    // From pixels that are drawn, a Gaussian narrower than one has not quite this width.
    if (width > 0.5) deviations.push_back(width);
  }
  // Two thirds of them, uniform in [0.5, 1.5].
  EXPECT_NEAR(static_cast<double>(deviations.size()) / kImages, 2 / 3.,
              5 * std::sqrt(2 / 9. / kImages));
  for (double& deviation : deviations) deviation -= 0.5;
  expect_uniform(deviations, 1);
}

// Independent noise averages out: by the sum of squares of the weights.
TEST(CameraAugmentationTest, BlurTakesNoiseAway) {
  v1::CameraAugmentation camera;
  camera.set_blur(1.5);
  ImageBatch noisy = uniform_images();
  torch::manual_seed(1);
  noisy.luminance = noisy.luminance * (1 + 0.1 * torch::randn({kImages, kSize, kSize}));
  const ImageBatch quiet = with_camera_effects(uniform_images(), camera, 8),
                   result = with_camera_effects(noisy, camera, 8);
  // In the middle, where no border matters: what is said, over what is.
  const auto middle = [](const torch::Tensor& t) { return t.narrow(1, 12, 8).narrow(2, 12, 8); };
  const torch::Tensor said = middle(quiet.noise).square().mean({1, 2});
  const torch::Tensor is =
      (middle(result.luminance) / middle(quiet.luminance) - 1).square().mean({1, 2});
  // Each image knows its mean square to some 10 %, all 200 to one: five standard errors.
  EXPECT_NEAR((is / said).mean().item<double>(), 1, 0.06);
  EXPECT_LT(said.min().item<double>(), 0.2 * 0.01);
  EXPECT_GT(said.max().item<double>(), 0.95 * 0.01);
}

TEST(CameraAugmentationTest, EverySecondImageLosesItsHighlights) {
  v1::CameraAugmentation camera;
  camera.set_clipped(0.4);
  torch::manual_seed(2);
  ImageBatch batch = images();
  batch.luminance = torch::rand({kImages, kSize, kSize}) * batch.mask;  // no two are the same
  const ImageBatch result = with_camera_effects(batch, camera, 9);
  std::vector<double> parts;
  int untouched = 0;
  for (int64_t i = 0; i < kImages; ++i) {
    const torch::Tensor changed = result.luminance[i] < batch.luminance[i];
    if (!changed.any().item<bool>()) {
      ++untouched;
      continue;
    }
    const double white = result.luminance[i].max().item<double>();
    const torch::Tensor at_top = result.luminance[i] == white;
    parts.push_back(at_top.sum().item<double>() / (kSide * kSide));
    EXPECT_TRUE(result.luminance[i].equal(batch.luminance[i].clamp_max(white)));
    EXPECT_EQ((result.noise[i] * at_top).max().item<double>(), 0);
  }
  EXPECT_NEAR(untouched, kImages / 2, 6 * std::sqrt(kImages / 4.0));
  expect_uniform(parts, 0.4);
}

// An object of one luminance L before a background B: where the mask reaches beyond the object, B
// is in it; inside nothing changes.
TEST(CameraAugmentationTest, AMaskThatIsOffHasBackgroundInIt) {
  v1::CameraAugmentation camera;
  camera.set_mask(2);
  const ImageBatch batch = uniform_images();
  const ImageBatch result = with_camera_effects(batch, camera, 10);
  std::vector<double> areas, x, backgrounds;
  const torch::Tensor columns = torch::arange(kSize, torch::kFloat32);
  for (int64_t i = 0; i < kImages; ++i) {
    const torch::Tensor mask = result.mask[i];
    EXPECT_GE(mask.min().item<double>(), 0);
    EXPECT_LE(mask.max().item<double>(), 1 + 1e-6);
    areas.push_back(std::sqrt(mask.sum().item<double>()));
    x.push_back((mask.sum(0) * columns).sum().item<double>() / mask.sum().item<double>());
    const torch::Tensor object = (batch.mask[i] > 0.5) & (mask > 0.01);
    EXPECT_NEAR(result.luminance[i].masked_select(object).min().item<double>(), 2, 1e-4);
    EXPECT_NEAR(result.luminance[i].masked_select(object).max().item<double>(), 2, 1e-4);
    EXPECT_EQ((result.luminance[i] * (mask < 1e-6)).max().item<double>(), 0);
    const torch::Tensor outside = (batch.mask[i] < 0.5) & (mask > 0.01);
    if (outside.any().item<bool>()) {
      const torch::Tensor behind = result.luminance[i].masked_select(outside);
      EXPECT_NEAR(behind.min().item<double>(), behind.max().item<double>(), 1e-3);
      backgrounds.push_back(behind.mean().item<double>());
    }
  }
  // Sides are 16 and twice what they are wider, which is uniform in [-2, 2].
  for (double& side : areas) side = (side - 16) / 2 + 2;
  const auto [wider, deviation] = moments(areas);
  EXPECT_NEAR(wider, 2, 5 * 4 / std::sqrt(12.0 * kImages) + 0.05);
  EXPECT_NEAR(deviation, 4 / std::sqrt(12.0), 0.15);
  for (double& middle : x) middle -= 15.5 - 2;
  expect_uniform(x, 4);
  ASSERT_GT(backgrounds.size(), kImages / 2);
  expect_uniform(backgrounds, 6);
}

// What a render shows behind the object where that fills a part of a pixel tells of the light.
TEST(CameraAugmentationTest, TheBorderIsAsBrightAsTheObjectNearby) {
  v1::CameraAugmentation camera;
  camera.set_clipped(1e-6);  // less than a pixel
  ImageBatch batch = uniform_images();
  inside(batch.mask).select(1, 0).fill_(0.5);
  inside(batch.luminance).select(1, 0).fill_(50);
  const ImageBatch result = with_camera_effects(batch, camera, 14);
  EXPECT_TRUE(result.mask.equal(batch.mask));
  const torch::Tensor border = inside(result.luminance).select(1, 0);
  EXPECT_NEAR(border.min().item<double>(), 2, 1e-4);
  EXPECT_NEAR(border.max().item<double>(), 2, 1e-4);
  EXPECT_TRUE(inside(result.luminance)
                  .narrow(1, 1, kSide - 1)
                  .allclose(inside(batch.luminance).narrow(1, 1, kSide - 1)));
}

// A background that is brighter shines onto a blurred border, a black one takes from it.
TEST(CameraAugmentationTest, BlurMixesObjectAndBackground) {
  v1::CameraAugmentation camera;
  camera.set_blur(1.5);
  const ImageBatch batch = uniform_images();
  const ImageBatch result = with_camera_effects(batch, camera, 11);
  EXPECT_TRUE(result.mask.equal(batch.mask));
  int brighter = 0, darker = 0;
  for (int64_t i = 0; i < kImages; ++i) {
    EXPECT_NEAR(at(result.luminance, i, 16, 16), 2, 1e-4);
    const double rim = at(result.luminance, i, 16, 8);
    EXPECT_LT(rim, 4);  // half of the background, of up to three times 2, at most
    if (rim > 2.05) ++brighter;
    if (rim < 1.95) ++darker;
  }
  EXPECT_GT(brighter, kImages / 3);
  EXPECT_GT(darker, kImages / 8);
}

TEST(CameraAugmentationTest, LeavesNoNumberThatIsNone) {
  ImageBatch black = images();
  black.luminance.fill_(0);
  ImageBatch noise = images(HUGE_VAL);
  ImageBatch nothing = images();
  nothing.mask.fill_(0);
  for (const ImageBatch& batch : {black, noise, nothing}) {
    const ImageBatch result = with_camera_effects(batch, default_camera_augmentation(), 12);
    for (const torch::Tensor& plane : {result.luminance, result.mask}) {
      EXPECT_TRUE(torch::isfinite(plane).all().item<bool>());
      EXPECT_GE(plane.min().item<double>(), 0);
    }
    EXPECT_FALSE(torch::isnan(result.noise).any().item<bool>());
  }
}

// Before noise is added, which fills up to the level what the camera has left of a render's.
TEST(CameraAugmentationTest, ComesBeforeNoise) {
  v1::Augmentation augmentation;
  *augmentation.mutable_camera() = default_camera_augmentation();
  augmentation.mutable_noise()->set_min(0.3);
  augmentation.mutable_noise()->set_max(0.3);
  const ImageBatch result = augmented(images(), augmentation, 13);
  EXPECT_GE(result.noise.min().item<double>(), 0.3 - 1e-6);
  EXPECT_LE(inside(result.noise).max().item<double>(), 0.3 + 1e-6);
}

TEST(CameraAugmentationTest, SaysWhatIsOutOfRange) {
  EXPECT_NO_THROW(validate(default_camera_augmentation()));
  const auto expect = [](const std::string& message, void (*change)(v1::CameraAugmentation&)) {
    v1::Augmentation augmentation;
    change(*augmentation.mutable_camera());
    try {
      validate(augmentation);
      ADD_FAILURE() << "no error; expected: " << message;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr(message));
    }
  };
  using Camera = v1::CameraAugmentation;
  expect("augmentation.camera.share is 1.5; it must be in [0, 1]",
         [](Camera& c) { c.set_share(1.5); });
  expect("camera.contrast is -1; it must be in [0, 1]", [](Camera& c) { c.set_contrast(-1); });
  expect("camera.shoulder is 11", [](Camera& c) { c.set_shoulder(11); });
  expect("camera.vignetting is 3", [](Camera& c) { c.set_vignetting(3); });
  expect("camera.blur is nan", [](Camera& c) { c.set_blur(std::nan("")); });
  expect("camera.clipped is 0.6", [](Camera& c) { c.set_clipped(0.6); });
  expect("camera.mask is 9", [](Camera& c) { c.set_mask(9); });
}

}  // namespace
}  // namespace itn
