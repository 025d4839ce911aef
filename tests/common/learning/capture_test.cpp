#include "common/learning/capture.h"

#include <limits>
#include <numbers>

#include <gmock/gmock.h>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using ::testing::ElementsAre;
using testing::expect_error;
using ::testing::HasSubstr;
using ::testing::Not;

struct Pixels {
  int side, channels;
  std::vector<float> values, mask;
  Photograph view() const { return {side, side, channels, values, mask}; }
};

// An object in the middle of a square.
Pixels picture(int side, int channels) {
  Pixels p{
      side, channels, std::vector<float>(static_cast<size_t>(side) * side * channels, 0.5F), {}};
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      p.mask.push_back(x > 3 && x < side - 4 && y > 3 && y < side - 4 ? 1.0F : 0.0F);
    }
  }
  return p;
}

v1::Model model_of(v1::Exposure exposure, double irradiance = 0) {
  v1::Model model;
  model.set_name("test");
  model.set_resolution(16);
  model.set_exposure(exposure);
  model.set_irradiance(irradiance);
  return model;
}

std::vector<v1::Warning::Kind> kinds(const std::vector<v1::Warning>& warnings) {
  std::vector<v1::Warning::Kind> result;
  for (const v1::Warning& warning : warnings) result.push_back(warning.kind());
  return result;
}

TEST(Capture, SaysWhatIsOutOfRange) {
  const auto wrong = [](const char* message, const auto& set) {
    v1::Capture capture;
    set(capture);
    expect_error(ErrorKind::kInvalidInput, {message}, [&] { validate(capture, 3); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  wrong("capture.object_size is 0; it must be in", [](auto& c) { c.set_object_size(0); });
  wrong("capture.object_size", [nan](auto& c) { c.set_object_size(nan); });
  wrong("capture.exposure is -1; it must be in", [](auto& c) { c.set_exposure(-1); });
  wrong("capture.white is 0; it must be in [1e-12, 1000000000000]",
        [](auto& c) { c.add_white(0); });
  wrong("capture.white has 2 numbers", [](auto& c) {
    c.add_white(1);
    c.add_white(1);
  });
  wrong("both exposure and white", [](auto& c) {
    c.set_exposure(1);
    c.add_white(1);
  });
  wrong("capture.clipped is 1.5; it must be in [0, 1]", [](auto& c) { c.set_clipped(1.5); });
  EXPECT_NO_THROW(validate(v1::Capture(), 1));
}

TEST(Capture, BringsRadianceToTheScaleOfTraining) {
  const v1::Model absolute = model_of(v1::EXPOSURE_KNOWN), card = model_of(v1::EXPOSURE_KNOWN, 100);
  v1::Capture capture;
  EXPECT_EQ(radiance_factor(capture, absolute, 0), 1);
  capture.set_exposure(3);
  EXPECT_EQ(radiance_factor(capture, absolute, 0), 3);
  EXPECT_EQ(radiance_factor(capture, model_of(v1::EXPOSURE_UNKNOWN), 0), 1);
  // A white card under 100 W/m^2 has a radiance of 100 / pi.
  capture.clear_exposure();
  capture.mutable_white()->Add(0.5);
  EXPECT_DOUBLE_EQ(radiance_factor(capture, card, 2), 200 / std::numbers::pi);
  capture.mutable_white()->Add(0.25);
  capture.mutable_white()->Add(1);
  EXPECT_DOUBLE_EQ(radiance_factor(capture, card, 1), 400 / std::numbers::pi);
  EXPECT_EQ(radiance_factor(capture, model_of(v1::EXPOSURE_UNKNOWN), 1), 1);
  expect_error(ErrorKind::kInvalidInput, {"the model test", "white card"},
               [&] { radiance_factor(capture, absolute, 0); });
}

TEST(Capture, WarnsOfWhatIsUnknown) {
  const Pixels p = picture(32, 1);
  v1::Capture capture;
  EXPECT_THAT(kinds(warnings(p.view(), capture, model_of(v1::EXPOSURE_KNOWN))[0]),
              ElementsAre(v1::Warning::EXPOSURE_UNKNOWN, v1::Warning::SIZE_UNKNOWN));
  EXPECT_THAT(kinds(warnings(p.view(), capture, model_of(v1::EXPOSURE_UNKNOWN))[0]),
              ElementsAre(v1::Warning::SIZE_UNKNOWN));
  capture.set_object_size(40);
  capture.set_exposure(1);
  EXPECT_THAT(kinds(warnings(p.view(), capture, model_of(v1::EXPOSURE_KNOWN))[0]), ElementsAre());
}

TEST(Capture, WarnsOfWhatIsLost) {
  const v1::Model model = model_of(v1::EXPOSURE_UNKNOWN);
  v1::Capture capture;
  capture.set_object_size(40);
  capture.set_clipped(0.009);
  EXPECT_THAT(kinds(warnings(picture(32, 1).view(), capture, model)[0]), ElementsAre());
  capture.set_clipped(0.12);
  capture.set_encoded(true);
  const auto all = warnings(picture(32, 1).view(), capture, model)[0];
  EXPECT_THAT(kinds(all), ElementsAre(v1::Warning::CLIPPED, v1::Warning::ENCODED));
  EXPECT_THAT(all[0].text(), HasSubstr("12 % of the object"));
  // The curve counts where the scale does.
  EXPECT_THAT(all[1].text(), Not(HasSubstr("misleads")));
  capture.set_exposure(1);
  const auto scaled = warnings(picture(32, 1).view(), capture, model_of(v1::EXPOSURE_KNOWN))[0];
  EXPECT_THAT(scaled.back().text(), HasSubstr("misleads the albedo"));
}

TEST(Capture, SeesAnObjectThatIsCutSmallOrBlack) {
  const v1::Model model = model_of(v1::EXPOSURE_UNKNOWN);
  v1::Capture capture;
  capture.set_object_size(40);
  Pixels cut = picture(32, 1);
  cut.mask[5] = 1;
  EXPECT_THAT(kinds(warnings(cut.view(), capture, model)[0]),
              ElementsAre(v1::Warning::CUT_BY_FRAME));
  EXPECT_THAT(kinds(warnings(picture(15, 1).view(), capture, model)[0]),
              ElementsAre(v1::Warning::SMALL));
  Pixels red = picture(32, 3);
  for (size_t i = 0; i < red.values.size(); ++i) {
    if (i % 3 != 0) red.values[i] = 0;
  }
  const auto by_channel = warnings(red.view(), capture, model);
  ASSERT_EQ(by_channel.size(), 3);
  EXPECT_THAT(kinds(by_channel[0]), ElementsAre());
  EXPECT_THAT(kinds(by_channel[1]), ElementsAre(v1::Warning::BLACK));
  EXPECT_THAT(kinds(by_channel[2]), ElementsAre(v1::Warning::BLACK));
  // What its client cut out of a photograph, the client must say.
  capture.set_cut_by_frame(true);
  EXPECT_THAT(kinds(warnings(picture(32, 1).view(), capture, model)[0]),
              ElementsAre(v1::Warning::CUT_BY_FRAME));
}

}  // namespace
}  // namespace itn
