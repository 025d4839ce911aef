// itn merge, as a process.
#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "client/image/attributes.h"
#include "client/image/image.h"
#include "client/image/preview.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::AllOf;
using namespace testing;
using ::testing::HasSubstr;

using Arguments = std::vector<std::string>;

constexpr int kWidth = 96;
constexpr int kHeight = 32;

float radiance(int x) {
  return std::pow(10.0F, 3 * static_cast<float>(x) / kWidth - 2);
}

// Three exposures of a ramp of light, without EXIF.
class MergeCommand : public ::testing::Test {
 protected:
  MergeCommand() {
    for (const float seconds : {0.25F, 1.0F, 4.0F}) {
      std::vector<unsigned char> rgb;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x)
          rgb.insert(rgb.end(), 3, to_srgb_byte(seconds * radiance(x)));
      }
      photographs_.push_back(folder_.path("photo" + std::to_string(photographs_.size()) + ".png"));
      write_png(photographs_.back(), kWidth, kHeight, rgb);
    }
  }

  Finished merge(const Arguments& more) const {
    Arguments arguments{testing::kItn, "merge", "-o", folder_.path("out.exr")};
    arguments.insert(arguments.end(), photographs_.begin(), photographs_.end());
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run(arguments);
  }

  TemporaryFolder folder_;
  Arguments photographs_;
};

TEST_F(MergeCommand, WritesLinearRadiance) {
  for (const Arguments& more : {Arguments{"--response", "srgb"}, Arguments{}}) {
    Arguments arguments{"--seconds", "1/4,1,4"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Finished finished = merge(arguments);
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_THAT(finished.output, AllOf(HasSubstr("3 photographs"), HasSubstr("0.25 to 4 s")));
    const Image image = read_exr(folder_.path("out.exr"));
    // R, G, B, and where all photographs are clipped.
    EXPECT_EQ(image.channels.size(), 4U);
    EXPECT_TRUE(image.has("clipped.Y"));
    for (int x = 20; x < 80; ++x) {
      EXPECT_NEAR(image.channel("G")[static_cast<size_t>(x)] / radiance(x), 1, 0.08) << x;
    }
    EXPECT_EQ(image.attributes.at(attribute::kExposures), Attribute("0.25,1,4"));
    EXPECT_EQ(image.attributes.at(attribute::kMergeMethod), Attribute("debevec"));
    EXPECT_EQ(image.attributes.at(attribute::kResponse),
              Attribute(more.empty() ? "estimate" : "srgb"));
  }
}

// f-number and sensitivity count where they differ. (A time like 1/8 OpenImageIO writes as 0.)
TEST_F(MergeCommand, TakesExposuresFromExif) {
  struct Taken {
    float seconds, f_number;
    int iso;
    unsigned char code;  // in sRGB, of the same light
  };
  Arguments arguments{testing::kItn, "merge", "-o", folder_.path("out.exr"), "--response", "srgb"};
  for (const Taken& taken :
       {Taken{0.0125F, 4, 100, 128}, Taken{0.0125F, 4, 400, 238}, Taken{0.0125F, 8, 100, 64}}) {
    arguments.push_back(folder_.path("photo" + std::to_string(arguments.size()) + ".jpg"));
    OIIO::ImageSpec spec(8, 8, 3, OIIO::TypeDesc::UINT8);
    spec.attribute("ExposureTime", taken.seconds);
    spec.attribute("FNumber", taken.f_number);
    spec.attribute("Exif:PhotographicSensitivity", taken.iso);
    const std::vector<unsigned char> gray(8 * 8 * 3, taken.code);
    const auto output = OIIO::ImageOutput::create(arguments.back());
    ASSERT_TRUE(output->open(arguments.back(), spec) &&
                output->write_image(OIIO::TypeDesc::UINT8, gray.data()) && output->close());
  }
  const Finished finished = run(arguments);
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(read_exr(folder_.path("out.exr")).attributes.at(attribute::kExposures),
            Attribute("0.0125,0.05,0.003125"));
}

TEST_F(MergeCommand, SaysWhatIsWrong) {
  Finished finished = merge({});
  EXPECT_EQ(finished.exit_code, 3);
  EXPECT_THAT(finished.errors, AllOf(HasSubstr("photo0.png does not say for how long"),
                                     HasSubstr("--seconds 1/60,1/15")));
  finished = merge({"--seconds", "1,1,1"});
  EXPECT_EQ(finished.exit_code, 3);
  EXPECT_THAT(finished.errors, HasSubstr("all photographs have an exposure of 1 s"));
  finished = merge({"--seconds", "1,2"});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.errors, HasSubstr("2 times for 3 photographs"));
  finished = merge({"--seconds", "1,2,1/0"});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.errors, HasSubstr("1/0 is not a time in seconds"));
  finished = run({testing::kItn, "merge", photographs_[0], "-o", folder_.path("out.exr")});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.errors, HasSubstr("two photographs at least"));
  write_png(photographs_[1], 4, 2, std::vector<unsigned char>(24, 100));
  for (const char* response : {"srgb", "estimate"}) {
    finished = merge({"--seconds", "1/4,1,4", "--response", response});
    EXPECT_EQ(finished.exit_code, 3);
    EXPECT_THAT(finished.errors, AllOf(HasSubstr("photo1.png has 4 x 2 pixels"),
                                       HasSubstr("photo0.png has 96 x 32")));
  }
}

TEST_F(MergeCommand, WritesOverNoPhotographAndUnderNoOtherFormatsName) {
  const auto to = [this](const std::string& output) {
    return run({testing::kItn, "merge", photographs_[0], photographs_[1], "--seconds", "1/4,1",
                "--response", "srgb", "-o", output});
  };
  ASSERT_EQ(to(folder_.path("first.exr")).exit_code, 0);
  ASSERT_EQ(to(folder_.path("second")).exit_code, 0);
  Finished finished =
      run({testing::kItn, "merge", folder_.path("first.exr"), folder_.path("second"), "--seconds",
           "1,4", "-o", folder_.path("./first.exr")});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.errors, HasSubstr("that is the input " + folder_.path("first.exr")));
  finished = to(folder_.path("new.png"));
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.errors, HasSubstr("name it .exr"));
}

TEST_F(MergeCommand, IsKnownToHelpAndCompletion) {
  EXPECT_THAT(run({testing::kItn, "--help"}).output, HasSubstr("merge"));
  EXPECT_THAT(run({testing::kItn, "completion", "bash"}).output, HasSubstr("merge) words=\""));
}

}  // namespace
}  // namespace itn
