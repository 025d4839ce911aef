#include "client/predict/picture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>

#include "client/image/preview.h"
#include "tests/client/predict/decoded_png.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;
using ::testing::Each;

constexpr int kSide = 8;
constexpr Rgb kWhite{255, 255, 255}, kBlack{0, 0, 0}, kRed{255, 0, 0}, kBlue{0, 0, 255};
constexpr Rgb kOrange{255, 128, 0};

size_t at(int x, int y) {
  return static_cast<size_t>(y * kSide + x);
}
bool is_object(int x, int y) {
  return x >= 2 && x < 6 && y >= 2 && y < 6;
}

// A square of 4 x 4 pixels of this colour, with light of 8 around it.
PredictInput photograph(const std::vector<float>& colour) {
  PredictInput input;
  FramedPhotograph& framed = input.photograph;
  framed.side = kSide;
  framed.channels = static_cast<int>(colour.size());
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const bool object = is_object(x, y);
      for (const float c : colour) framed.pixels.push_back(object ? c : 8);
      framed.mask.push_back(object ? 1 : 0);
    }
  }
  return input;
}

// A render of the object alone, so many times as bright as the photograph.
std::vector<float> render_of(const PredictInput& input, float factor) {
  std::vector<float> result = input.photograph.pixels;
  const size_t channels = result.size() / input.photograph.mask.size();
  for (size_t i = 0; i < result.size(); ++i) {
    result[i] *= factor * input.photograph.mask[i / channels];
  }
  return result;
}

const std::vector<float> kColour{0.5F, 2, 1};  // white is 2

TEST(PredictPicture, ShowsThePhotographWithWhiteAsOnTheObject) {
  const PanelRow row = network_view_panels(photograph(kColour));
  ASSERT_EQ(row.size(), 3);
  for (const Panel& panel : row) {
    EXPECT_EQ(panel.side, kSide);
    EXPECT_EQ(panel.pixels.size(), kSide * kSide);
  }
  EXPECT_EQ(row[0].pixels[at(3, 3)], (Rgb{to_srgb_byte(0.25F), 255, to_srgb_byte(0.5F)}));
  EXPECT_EQ(row[0].pixels[at(0, 0)], kWhite);
  EXPECT_EQ(network_view_panels(photograph({7}))[0].pixels[at(3, 3)], kWhite)
      << "of one channel: gray";
}

TEST(PredictPicture, DrawsTheOutlineOfTheMaskAndDimsWhatIsOutside) {
  const PanelRow row = network_view_panels(photograph(kColour));
  EXPECT_EQ(std::ranges::count(row[1].pixels, kOrange), 12) << "the border of a square of 4 x 4";
  EXPECT_EQ(row[1].pixels[at(2, 5)], kOrange);
  EXPECT_EQ(row[1].pixels[at(3, 4)], row[0].pixels[at(3, 4)]);
  const Rgb outside = row[1].pixels[at(1, 3)];  // .12 of 8 / 2
  EXPECT_EQ(outside, gray(0.48F));
  EXPECT_LT(outside[0], row[0].pixels[at(1, 3)][0]);
}

TEST(PredictPicture, OutlinesAnObjectThatFillsTheFrameAtItsEdges) {
  PredictInput input = photograph(kColour);
  std::ranges::fill(input.photograph.mask, 1.0F);
  EXPECT_EQ(std::ranges::count(network_view_panels(input)[1].pixels, kOrange), 4 * (kSide - 1));
}

TEST(PredictPicture, ShowsTheWeightMapBrightestAtEdges) {
  const Panel weights = network_view_panels(photograph(kColour))[2];
  const auto brightness = [&](int x, int y) {
    const Rgb pixel = weights.pixels[at(x, y)];
    return pixel[0] + pixel[1] + pixel[2];
  };
  EXPECT_EQ(weights.pixels[at(0, 0)], kBlack);
  EXPECT_GT(brightness(3, 3), 0);
  EXPECT_GT(brightness(2, 3), brightness(3, 3));
}

TEST(PredictPicture, ShowsARerenderingAndItsDifference) {
  const PredictInput input = photograph(kColour);
  const PanelRow same = rerendered_panels(input, render_of(input, 1));
  ASSERT_EQ(same.size(), 2);
  EXPECT_EQ(same[0].pixels[at(3, 3)], network_view_panels(input)[0].pixels[at(3, 3)]);
  EXPECT_EQ(same[0].pixels[at(0, 0)], kBlack);
  EXPECT_THAT(same[1].pixels, Each(kWhite)) << "what is outside of the mask is not compared";
  EXPECT_EQ(rerendered_panels(input, render_of(input, 3))[1].pixels[at(3, 3)], kRed);
  EXPECT_EQ(rerendered_panels(input, render_of(input, 0))[1].pixels[at(3, 3)], kBlue);
  // It shows an object where there should be none.
  std::vector<float> larger = render_of(input, 1);
  for (size_t c = 0; c < 3; ++c) larger[3 * at(1, 1) + c] = 2;
  EXPECT_EQ(rerendered_panels(input, larger)[1].pixels[at(1, 1)], kRed);
}

TEST(PredictPicture, BringsARerenderingToTheScaleOfThePhotograph) {
  PredictInput input = photograph(kColour);
  input.capture.set_exposure(4);  // radiance is 4 times what the image says
  EXPECT_THAT(rerendered_panels(input, render_of(input, 4))[1].pixels, Each(kWhite));
  EXPECT_EQ(rerendered_panels(input, render_of(input, 12))[1].pixels[at(3, 3)], kRed);
  input.capture.set_encoded(true);
  EXPECT_EQ(rerendered_panels(input, render_of(input, 12))[1].pixels[at(3, 3)], kRed);
  // The scale is unknown: the means are made equal.
  input.capture.clear_exposure();
  EXPECT_THAT(rerendered_panels(input, render_of(input, 12))[1].pixels, Each(kWhite));
}

TEST(Panels, AreEnlargedByAWholeNumberAndStandBesideOneAnother) {
  EXPECT_EQ(enlargement(8), 32);
  EXPECT_EQ(enlargement(100), 3);
  EXPECT_EQ(enlargement(256), 1);
  const TemporaryFolder folder;
  const Panel dark{.side = 100, .pixels = std::vector<Rgb>(10'000, kBlack)};
  PanelRow row = network_view_panels(photograph(kColour));
  write_panels(folder.path("panels.png"), std::vector<PanelRow>{row, {dark, dark}});
  std::ifstream file(folder.path("panels.png"), std::ios::binary);
  const DecodedPng png = decoded_png(
      std::string(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()));
  EXPECT_EQ(png.width, 3 * 256 + 2 * 8);
  EXPECT_EQ(png.height, 256 + 8 + 300);
  EXPECT_EQ(png.at(3 * 32, 3 * 32), row[0].pixels[at(3, 3)]);
  EXPECT_EQ(png.at(4 * 32 - 1, 4 * 32 - 1), row[0].pixels[at(3, 3)]);
  EXPECT_EQ(png.at(256 + 8 + 2 * 32, 2 * 32), kOrange);
  EXPECT_EQ(png.at(260, 100), kWhite) << "the gap";
  EXPECT_EQ(png.at(0, 264), kBlack);
  EXPECT_EQ(png.at(607, 563), kBlack);
  EXPECT_EQ(png.at(608, 563), kWhite);
}

}  // namespace
}  // namespace itn
