#include "client/image/exposure_merge.h"

#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "client/image/photograph_file.h"
#include "client/image/srgb.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;

constexpr int kWidth = 240;
constexpr int kHeight = 180;

// Radiance over three and a half decades, of other colours everywhere: bumps on a ramp.
std::vector<double> scene() {
  std::vector<double> radiance;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      for (int c = 0; c < 3; ++c) {
        const double decades = 3.5 * x / kWidth + 0.4 * std::sin(0.05 * y + c) - 2.2;
        radiance.push_back(std::pow(10, decades));
      }
    }
  }
  return radiance;
}

using Curve = std::function<double(double)>;  // encoded value of light, both in [0, 1]

// The curve of a film: steep where it is dark, bent where it is light.
double film(double light) {
  return std::sqrt((1 - std::exp(-2.5 * light)) / (1 - std::exp(-2.5)));
}

PhotographFile photograph(const std::vector<double>& radiance, double seconds, const Curve& curve,
                          const std::string& format) {
  std::vector<uint8_t> bytes;
  for (const double value : radiance) {
    bytes.push_back(static_cast<uint8_t>(std::lround(255 * curve(std::min(1.0, value * seconds)))));
  }
  const TemporaryFolder folder;
  const std::string path = folder.path("a." + format);
  OIIO::ImageSpec spec(kWidth, kHeight, 3, OIIO::TypeDesc::UINT8);
  spec.attribute("CompressionQuality", 95);
  const auto output = OIIO::ImageOutput::create(path);
  EXPECT_TRUE(output->open(path, spec) &&
              output->write_image(OIIO::TypeDesc::UINT8, bytes.data()) && output->close());
  return read_photograph(path);
}

struct Bracket {
  std::vector<double> seconds;
  std::vector<PhotographFile> files;
};

Bracket bracket(const std::vector<double>& radiance, const std::vector<double>& seconds,
                const Curve& curve, const std::string& format) {
  Bracket taken{seconds, {}};
  for (const double time : seconds) {
    taken.files.push_back(photograph(radiance, time, curve, format));
  }
  return taken;
}

Response estimated(const Bracket& taken) {
  std::vector<ExposureSample> samples;
  for (size_t i = 0; i < taken.files.size(); ++i) {
    samples.push_back(sample_exposure(taken.files[i], taken.seconds[i], "photo"));
  }
  return estimate_response(samples);
}

Image merged(const Bracket& taken, const Response& response) {
  ExposureMerge merge(response);
  for (size_t i = 0; i < taken.files.size(); ++i) {
    merge.add(taken.files[i], taken.seconds[i], "photo");
  }
  return merge.merged();
}

struct Ratio {
  double median = 0;
  double spread = 0;    // of 99 % of the values about it
  double greatest = 0;  // distance from it
};

// The ratio of the merged image to the truth, where an exposure shows the light neither at the ends
// of its range nor next to them.
Ratio ratio_to(const std::vector<double>& radiance, const Image& image, const Bracket& taken,
               const Curve& curve) {
  std::vector<double> ratios;
  for (size_t i = 0; i < radiance.size(); ++i) {
    const bool well_exposed = std::ranges::any_of(taken.seconds, [&](double seconds) {
      const double encoded = radiance[i] * seconds < 1 ? curve(radiance[i] * seconds) : 1;
      return encoded > 0.15 && encoded < 0.9;
    });
    if (well_exposed) {
      ratios.push_back(image.channel(std::string(1, "RGB"[i % 3]))[i / 3] / radiance[i]);
    }
  }
  EXPECT_GT(static_cast<double>(ratios.size()), 0.8 * static_cast<double>(radiance.size()));
  std::ranges::sort(ratios);
  const double median = ratios[ratios.size() / 2];
  std::vector<double> distances;
  for (const double ratio : ratios) distances.push_back(std::abs(ratio / median - 1));
  std::ranges::sort(distances);
  return {median, distances[distances.size() * 99 / 100], distances.back()};
}

struct Row {
  const char* name;
  double (*curve)(double);
  bool estimate;
  const char* format;
  std::vector<double> seconds;
  double spread;  // at most
  double greatest;
};

const std::vector<double> kFive{1 / 32.0, 1 / 8.0, 1 / 2.0, 2, 8};
const std::vector<double> kThree{1 / 16.0, 1 / 2.0, 4};

// Half a code at 15 % of the range is 1.3 % of the value, and 3 % of its light: nothing does better
// with a curve that is known. An estimated one adds as much. JPEG of quality 95, with
// half of the resolution in colour, is wrong by several codes in places.
const std::vector<Row> kRows{
    {"srgb_known", srgb_of_linear, false, "png", kFive, 0.02, 0.035},
    {"srgb_known_of_three", srgb_of_linear, false, "png", kThree, 0.02, 0.035},
    {"srgb_estimated", srgb_of_linear, true, "png", kFive, 0.03, 0.06},
    {"srgb_estimated_jpeg", srgb_of_linear, true, "jpg", kFive, 0.06, 0.18},
    {"film_estimated", film, true, "png", kFive, 0.03, 0.06},
    {"film_estimated_jpeg", film, true, "jpg", kFive, 0.06, 0.18},
    {"film_estimated_of_three", film, true, "png", kThree, 0.05, 0.1},
};

class ExposureMergeTest : public ::testing::TestWithParam<Row> {};

TEST_P(ExposureMergeTest, IsProportionalToTheRadiance) {
  const Row& row = GetParam();
  const std::vector<double> radiance = scene();
  const Bracket taken = bracket(radiance, row.seconds, row.curve, row.format);
  const Response response = row.estimate ? estimated(taken) : srgb_response(3);
  const Ratio ratio = ratio_to(radiance, merged(taken, response), taken, row.curve);
  std::printf("ratio %.4f, 99 %% within %.2f %%, all within %.2f %%\n", ratio.median,
              100 * ratio.spread, 100 * ratio.greatest);
  EXPECT_LT(ratio.spread, row.spread);
  EXPECT_LT(ratio.greatest, row.greatest);
  EXPECT_TRUE(row.curve != srgb_of_linear || std::abs(ratio.median - 1) < 0.03);
}

INSTANTIATE_TEST_SUITE_P(Table, ExposureMergeTest, ::testing::ValuesIn(kRows),
                         [](const auto& row) { return std::string(row.param.name); });

PhotographFile linear_file(const std::vector<float>& values) {
  PhotographFile file;
  file.image = {.width = static_cast<int>(values.size()),
                .height = 1,
                .channels = {{"Y", values}},
                .attributes = {}};
  return file;
}

TEST(ExposureMerge, LinearFilesNeedNoResponse) {
  ExposureMerge merge(std::nullopt);
  merge.add(linear_file({0.01F, 0.4F, 1}), 1, "a");
  merge.add(linear_file({0.0025F, 0.1F, 0.25F}), 0.25, "b");
  const Image image = merge.merged();
  EXPECT_NEAR(image.channel("Y")[0], 0.01F, 1e-6);
  EXPECT_NEAR(image.channel("Y")[1], 0.4F, 1e-5);
  EXPECT_NEAR(image.channel("Y")[2], 1, 1e-5);
  EXPECT_EQ(merge.clipped_count(), 0U) << "the brightest pixel of a linear file is not clipped";
}

// A linear file ends where many have one value, and no other is above it.
TEST(ExposureMerge, LinearFilesEndAtAPlateau) {
  std::vector<float> bright(40, 0.7F), dark(40, 0.5F);
  bright[0] = dark[0] = 0.1F;
  dark[1] = 0.6F;
  ExposureMerge merge(std::nullopt);
  merge.add(linear_file(bright), 1, "a");
  merge.add(linear_file(dark), 0.25, "b");
  EXPECT_NEAR(merge.merged().channel("Y")[1], 2.4F, 1e-4);
  EXPECT_NEAR(merge.merged().channel("Y")[2], 2, 1e-4);
}

PhotographFile gray(const std::vector<int>& codes) {
  PhotographFile file = linear_file({});
  file.encoded = true;
  file.image.width = static_cast<int>(codes.size());
  for (const int code : codes) {
    file.image.channels["Y"].push_back(static_cast<float>(linear_of_srgb(code / 255.0)));
  }
  return file;
}

// White in all: the shortest exposure's bound. Black in all: the longest one's.
TEST(ExposureMerge, KeepsBoundsWhereNothingWasExposedWell) {
  ExposureMerge merge(srgb_response(1));
  merge.add(gray({255, 128, 1}), 1, "a");
  merge.add(gray({255, 70, 0}), 0.25, "b");
  const Image image = merge.merged();
  EXPECT_FLOAT_EQ(image.channel("Y")[0], 4);
  EXPECT_NEAR(image.channel("Y")[1], linear_of_srgb(128 / 255.0), 0.02);
  EXPECT_FLOAT_EQ(image.channel("Y")[2], 0);
  EXPECT_EQ(merge.clipped_count(), 1U);
}

TEST(ExposureMerge, SaysWhatDoesNotFit) {
  ExposureMerge merge(srgb_response(1));
  merge.add(gray({255, 255, 0}), 1, "a.jpg");
  expect_error(ErrorKind::kInvalidInput, {"b.jpg has 2 x 1 pixels", "3 x 1"}, [&] {
    merge.add(gray({255, 0}), 2, "b.jpg");
  });
  merge.add(gray({255, 255, 0}), 2, "b.jpg");
  expect_error(ErrorKind::kInvalidInput, {"every pixel is black or white"},
               [&] { merge.merged(); });
}

// The light of one scene is the same by every exposure, if their times are right.
TEST(ExposureMerge, ComparesThePhotographsWithTheirTimes) {
  std::vector<float> values(400);
  for (size_t i = 0; i < values.size(); ++i) values[i] = 0.1F + 0.001F * static_cast<float>(i);
  const auto second = [&](double exposure) {
    ExposureMerge merge(std::nullopt);
    merge.add(linear_file(values), 1, "a");
    merge.add(linear_file(values), exposure, "b");
    return merge.doubts();
  };
  EXPECT_TRUE(second(1.1).empty());
  EXPECT_THAT(second(1.3), ::testing::ElementsAre(::testing::HasSubstr("0.769 times")));
  expect_error(ErrorKind::kInvalidInput, {"b: its light", "0.25 times", "order"},
               [&] { second(4); });
}

TEST(ExposureMerge, SaysThatNothingTellsTheResponse) {
  const std::vector<double> flat(3 * kWidth * kHeight, 0.2);
  expect_error(ErrorKind::kInvalidInput, {"do not tell the camera's response", "--response srgb"},
               [&] {
                 estimated(bracket(flat, {1, 1.5}, srgb_of_linear, "png"));
               });
  // Times in the wrong order: the curve would fall.
  const Bracket taken = bracket(scene(), kFive, srgb_of_linear, "png");
  expect_error(ErrorKind::kInvalidInput, {"do not tell the camera's response"}, [&] {
    estimated({{kFive.rbegin(), kFive.rend()}, taken.files});
  });
}

}  // namespace
}  // namespace itn
