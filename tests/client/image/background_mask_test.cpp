#include "client/image/background_mask.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <random>
#include <string>
#include <vector>

#include "client/image/mask_parts.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using testing::expect_error;

struct Picture {
  int width = 0;
  int height = 0;
  int channels = 3;
  std::vector<float> pixels;
  std::vector<float> mask;
};

struct Scene {
  const char* name;
  int width, height;
  int channels = 3;
  std::array<float, 3> object{}, background{};
  float slope = 0;      // of the background, from -slope to slope across the photograph, relative
  float noise = 0;      // relative
  float scale = 1;      // of all radiance
  float highlight = 0;  // on the object, in units of its radiance
};

// A ball of a third of the shorter side, not in the middle, lit from the upper left: its dark side
// has 30 % of the light.
Picture ball(const Scene& scene) {
  Picture picture{scene.width, scene.height, scene.channels, {}, {}};
  std::mt19937 random(7);
  std::normal_distribution<float> normal(0, scene.noise);
  const float radius = static_cast<float>(std::min(scene.width, scene.height)) / 3;
  for (int y = 0; y < scene.height; ++y) {
    for (int x = 0; x < scene.width; ++x) {
      const float u = (static_cast<float>(x) - 0.45F * static_cast<float>(scene.width)) / radius;
      const float v = (static_cast<float>(y) - 0.55F * static_cast<float>(scene.height)) / radius;
      const bool on_ball = u * u + v * v < 1;
      const float depth = std::sqrt(std::max(0.0F, 1 - u * u - v * v));
      const float towards_light = (-u - v + depth) / std::sqrt(3.0F);
      float light = 0.3F + 0.7F * std::max(0.0F, towards_light);
      if (towards_light > 0.98F) light += scene.highlight;
      const float across = 2 * static_cast<float>(x) / static_cast<float>(scene.width) - 1;
      picture.mask.push_back(on_ball ? 1 : 0);
      for (int c = 0; c < scene.channels; ++c) {
        const auto channel = static_cast<size_t>(c);
        const float value = on_ball ? light * scene.object[channel]
                                    : (1 + scene.slope * across) * scene.background[channel];
        picture.pixels.push_back(scene.scale * std::max(0.0F, value * (1 + normal(random))));
      }
    }
  }
  return picture;
}

double intersection_over_union(const std::vector<float>& a, const std::vector<float>& b) {
  double both = 0, either = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    both += a[i] > 0.5F && b[i] > 0.5F;
    either += a[i] > 0.5F || b[i] > 0.5F;
  }
  return both / either;
}

std::vector<float> mask_of(const Picture& picture) {
  return mask_from_background(picture.width, picture.height, picture.channels, picture.pixels);
}

const std::vector<Scene> kScenes{
    {.name = "plain",
     .width = 300,
     .height = 200,
     .object = {.8F, .5F, .3F},
     .background = {.1F, .1F, .1F}},
    {.name = "gray",
     .width = 200,
     .height = 200,
     .channels = 1,
     .object = {.8F},
     .background = {.1F}},
    {.name = "large",
     .width = 1500,
     .height = 1100,
     .object = {.8F, .5F, .3F},
     .background = {.1F, .1F, .1F}},
    {.name = "portrait",
     .width = 200,
     .height = 400,
     .object = {.8F, .5F, .3F},
     .background = {.1F, .1F, .1F}},
    {.name = "light_on_dark",
     .width = 300,
     .height = 300,
     .object = {.9F, .9F, .9F},
     .background = {.01F, .01F, .01F}},
    {.name = "dark_on_light",
     .width = 300,
     .height = 300,
     .object = {.1F, .1F, .1F},
     .background = {.8F, .8F, .8F}},
    {.name = "coloured_on_white",
     .width = 300,
     .height = 300,
     .object = {.3F, .6F, .2F},
     .background = {.9F, .9F, .9F}},
    {.name = "on_a_gradient",
     .width = 300,
     .height = 200,
     .object = {.1F, .2F, .1F},
     .background = {.6F, .6F, .6F},
     .slope = .4F},
    {.name = "light_on_a_gradient",
     .width = 300,
     .height = 200,
     .object = {.9F, .8F, .7F},
     .background = {.08F, .08F, .08F},
     .slope = .5F},
    {.name = "noisy",
     .width = 300,
     .height = 200,
     .object = {.8F, .5F, .3F},
     .background = {.1F, .1F, .1F},
     .noise = .15F},
    {.name = "noisy_dark_on_light",
     .width = 300,
     .height = 200,
     .object = {.1F, .1F, .1F},
     .background = {.7F, .7F, .7F},
     .noise = .1F},
    {.name = "of_any_scale",
     .width = 300,
     .height = 200,
     .object = {.8F, .5F, .3F},
     .background = {.1F, .1F, .1F},
     .scale = 1e5F},
    {.name = "with_a_highlight",
     .width = 300,
     .height = 200,
     .object = {.5F, .5F, .5F},
     .background = {.03F, .03F, .03F},
     .highlight = 1000},
};

class BackgroundMaskTest : public ::testing::TestWithParam<Scene> {};

// A shadow beside it, lit by the sky: darker than the ground, and a little bluer.
TEST(BackgroundMask, LeavesOutShadowsOfAColouredObject) {
  Picture picture = ball({.name = "shadow",
                          .width = 300,
                          .height = 300,
                          .object = {.8F, .55F, .25F},
                          .background = {.7F, .7F, .7F},
                          .noise = 0.05F});
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const size_t p = static_cast<size_t>(y) * picture.width + x;
      const double u = (x - 215) / 55.0, v = (y - 230) / 30.0;
      if (picture.mask[p] > 0 || u * u + v * v > 1) continue;
      for (size_t c = 0; c < 3; ++c) {
        picture.pixels[3 * p + c] *= std::array{0.40F, 0.43F, 0.48F}[c];
      }
    }
  }
  EXPECT_GT(intersection_over_union(mask_of(picture), picture.mask), 0.95);
}

TEST_P(BackgroundMaskTest, FindsTheBall) {
  const Picture picture = ball(GetParam());
  const std::vector<float> mask = mask_of(picture);
  ASSERT_EQ(mask.size(), picture.mask.size());
  const double iou = intersection_over_union(mask, picture.mask);
  std::printf("intersection over union %.4f\n", iou);
  EXPECT_GE(iou, 0.95);
  EXPECT_TRUE(std::ranges::all_of(mask, [](float v) { return v == 0 || v == 1; }));
}

INSTANTIATE_TEST_SUITE_P(Table, BackgroundMaskTest, ::testing::ValuesIn(kScenes),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(BackgroundMask, HasNoHoleWhereTheObjectLooksLikeTheBackground) {
  Picture picture = ball(kScenes[0]);
  const int centre_x = 135, centre_y = 110;
  for (int y = -10; y < 10; ++y) {
    for (int x = -10; x < 10; ++x) {
      for (int c = 0; c < 3; ++c) {
        const int pixel = (centre_y + y) * 300 + centre_x + x;
        picture.pixels[static_cast<size_t>(3 * pixel + c)] = 0.1F;
      }
    }
  }
  EXPECT_GE(intersection_over_union(mask_of(picture), picture.mask), 0.95);
}

TEST(BackgroundMask, IsOfTheLargerOfTwoObjects) {
  Picture picture = ball(kScenes[0]);
  for (int y = 20; y < 40; ++y) {
    for (int x = 260; x < 280; ++x) picture.pixels[static_cast<size_t>(3 * (y * 300 + x))] = 1;
  }
  EXPECT_GE(intersection_over_union(mask_of(picture), picture.mask), 0.95);
}

TEST(BackgroundMask, DoesNotDependOnThreadsOrOnWhatWasBefore) {
  const Picture picture = ball(kScenes[9]);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const std::vector<float> one = mask_of(picture);
  cv::setNumThreads(4);
  mask_of(ball(kScenes[2]));
  EXPECT_EQ(mask_of(picture), one);
  cv::setNumThreads(threads);
}

TEST(BackgroundMask, RefusesWhatHasNoObject) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.2F, 0.8F);
  const auto refused = [](int width, int height, const std::function<float(int, int)>& value,
                          const std::string& why) {
    std::vector<float> pixels;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) pixels.push_back(value(x, y));
    }
    expect_error(ErrorKind::kInvalidInput, {why},
                 [&] { mask_from_background(width, height, 1, pixels); });
  };
  refused(
      200, 150, [](int, int) { return 0.5F; }, "nothing differs from its border");
  refused(
      200, 150, [](int, int) { return 0.0F; }, "the photograph is black");
  refused(
      200, 150, [](int x, int) { return 0.2F + 0.001F * static_cast<float>(x); },
      "nothing differs from its border");
  refused(
      200, 150, [&](int, int) { return uniform(random); }, "no object can be told");
  refused(
      200, 150, [](int x, int y) { return x > 98 && x < 102 && y == 70 ? 1.0F : 0.1F; },
      "no object can be told");
  // A picture in a thin frame.
  refused(
      200, 150, [](int x, int y) { return x < 4 || y < 4 || x >= 196 || y >= 146 ? 0.9F : 0.1F; },
      "lies along most of its border");
  refused(
      15, 150, [](int, int) { return 0.5F; }, "15 x 150 pixels");
}

// A ring of 20 x 20 with a hole of 10 x 10, a part of 6 x 1 that touches it by a corner, one of 5 x
// 2 of its own, and two specks.
TEST(MaskParts, AreCountedWithoutSpecks) {
  constexpr int kWidth = 40, kHeight = 30;
  std::vector<float> mask(size_t{kWidth} * kHeight);
  const auto fill = [&](int left, int top, int width, int height, float value) {
    for (int y = top; y < top + height; ++y) {
      for (int x = left; x < left + width; ++x) mask[static_cast<size_t>(y) * kWidth + x] = value;
    }
  };
  fill(4, 4, 20, 20, 1);
  fill(9, 9, 10, 10, 0);
  fill(24, 24, 6, 1, 0.8F);
  fill(30, 2, 5, 2, 1);
  const std::vector<float> clean = mask;
  fill(0, 0, 1, 1, 1);
  fill(12, 12, 1, 1, 1);
  const MaskParts parts = drop_specks(mask, kWidth, kHeight);
  EXPECT_EQ(mask, clean);
  EXPECT_EQ(parts.specks, 2U);
  EXPECT_EQ(parts.speck_pixels, 2U);
  EXPECT_EQ(parts.parts, 2U);
  EXPECT_DOUBLE_EQ(parts.filled, (400 + 6 + 10) / 1200.0);
  EXPECT_DOUBLE_EQ(parts.largest_hole, 100 / 1200.0);
  EXPECT_FALSE(parts.is_rectangle);
  fill(0, 0, kWidth, kHeight, 0);
  fill(10, 8, 20, 15, 1);
  fill(15, 10, 6, 6, 0);
  EXPECT_TRUE(drop_specks(mask, kWidth, kHeight).is_rectangle);
  std::vector<float> black(12);
  EXPECT_EQ(drop_specks(black, 4, 3).parts, 0U);
}

}  // namespace
}  // namespace itn
