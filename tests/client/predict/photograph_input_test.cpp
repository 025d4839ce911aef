#include "client/predict/photograph_input.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <vector>

#include "client/image/image.h"
#include "client/image/photograph_file.h"
#include "client/image/preview.h"
#include "common/error.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using testing::expect_error;

// A scene of 60 x 40 pixels: a bright object, 20 x 10, on a dark ground, and a card.
constexpr int kWidth = 60, kHeight = 40;
constexpr int kLeft = 20, kTop = 12, kRight = 40, kBottom = 22;
constexpr PixelRectangle kCard{4, 30, 8, 6};
constexpr float kOfObject = 0.6F, kOfGround = 0.2F, kOfCard = 0.09F;

bool inside(int x, int y, const PixelRectangle& r) {
  return x >= r.x && x < r.x + r.width && y >= r.y && y < r.y + r.height;
}

bool on_object(int x, int y) {
  return inside(x, y, {kLeft, kTop, kRight - kLeft, kBottom - kTop});
}

class PhotographInput : public ::testing::Test {
 protected:
  // Linear, R, G and B in the ratio of 1 to 1 to 2; what `change` makes of it.
  template <typename Change>
  std::string exr(const std::string& name, const Change& change) const {
    Image image{kWidth, kHeight, {}, {}};
    for (const char* channel : {"R", "G", "B"}) {
      std::vector<float>& plane = image.channels[channel];
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          const float value = on_object(x, y)       ? kOfObject
                              : inside(x, y, kCard) ? kOfCard
                                                    : kOfGround;
          plane.push_back(channel[0] == 'B' ? 2 * value : value);
        }
      }
    }
    change(image);
    write_exr(folder_.path(name), image);
    return folder_.path(name);
  }
  // With a mask that is `on` on the object and `off` around it.
  PhotographOptions with_gray_mask(const std::string& name, unsigned char on,
                                   unsigned char off) const {
    std::vector<unsigned char> rgb;
    for (int i = 0; i < kWidth * kHeight; ++i) {
      rgb.insert(rgb.end(), 3, on_object(i % kWidth, i / kWidth) ? on : off);
    }
    write_png(folder_.path(name), kWidth, kHeight, rgb);
    PhotographOptions options;
    options.mask = folder_.path(name);
    return options;
  }
  std::string exr(const std::string& name) const {
    return exr(name, [](Image&) {});
  }

  // 255 on the object.
  std::string mask(const std::string& name, int width = kWidth) const {
    std::vector<unsigned char> rgb;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < width; ++x) rgb.insert(rgb.end(), 3, on_object(x, y) ? 255 : 0);
    }
    fs::create_directories(fs::path(folder_.path(name)).parent_path());
    write_png(folder_.path(name), width, kHeight, rgb);
    return folder_.path(name);
  }

  PhotographOptions with_mask() const {
    PhotographOptions options;
    options.mask = mask("mask.png");
    return options;
  }

  testing::TemporaryFolder folder_;
};

TEST_F(PhotographInput, FramesTheObjectOfAPhotograph) {
  const PredictInput input = load_photograph(exr("photo.exr"), with_mask());
  EXPECT_THAT(input.channels, ElementsAre("R", "G", "B"));
  EXPECT_EQ(input.photograph.side, std::lround(20 * 1.48));
  EXPECT_FALSE(input.capture.encoded());
  EXPECT_FALSE(input.capture.cut_by_frame());
  EXPECT_EQ(input.capture.clipped(), 0);
  EXPECT_FALSE(input.capture.has_object_size());
  EXPECT_TRUE(input.capture.white().empty());
}

TEST_F(PhotographInput, TakesSquareRendersWholeUnlessToldOtherwise) {
  Image render{32, 32, {}, {}};
  render.channels["Y"].assign(32 * 32, 1);
  for (int i = 0; i < 32 * 32; ++i) {
    render.channels["mask.Y"].push_back(i / 32 > 12 && i / 32 < 20 && i % 32 > 12 && i % 32 < 20);
  }
  write_exr(folder_.path("render.exr"), render);
  PhotographOptions options;
  EXPECT_EQ(load_photograph(folder_.path("render.exr"), options).photograph.side, 32);
  options.framing = Framing::kObject;
  EXPECT_EQ(load_photograph(folder_.path("render.exr"), options).photograph.side,
            std::lround(7 * 1.48));
}

TEST_F(PhotographInput, FindsTheMask) {
  const std::string photo = exr("photo.exr");
  const FramedPhotograph expected = load_photograph(photo, with_mask()).photograph;
  // In a folder, by its name, whatever its format.
  PhotographOptions folder;
  mask("masks/photo.png");
  folder.mask = folder_.path("masks");
  EXPECT_EQ(load_photograph(photo, folder).photograph.mask, expected.mask);
  // The mask as alpha.
  const std::string transparent = exr("transparent.exr", [](Image& image) {
    for (int i = 0; i < kWidth * kHeight; ++i) {
      image.channels["A"].push_back(on_object(i % kWidth, i / kWidth) ? 1.0F : 0.0F);
    }
  });
  EXPECT_EQ(load_photograph(transparent, {}).photograph.mask, expected.mask);
  // Before a plain background.
  PhotographOptions background;
  background.mask_by_background = true;
  const std::string plain = exr("plain.exr", [](Image& image) {
    for (auto& [name, plane] : image.channels) {
      for (float& value : plane) {
        if (value < (name == "B" ? 2 * kOfGround : kOfGround)) value *= kOfGround / kOfCard;
      }
    }
  });
  const FramedPhotograph found = load_photograph(plain, background).photograph;
  EXPECT_NEAR(found.side, expected.side, 2);
}

TEST_F(PhotographInput, SaysWhatIsWrongWithTheMask) {
  const std::string photo = exr("photo.exr");
  expect_error(ErrorKind::kInvalidInput, {"photo.exr has neither", "--mask", "--background auto"},
               [&] { load_photograph(photo, {}); });
  const std::string opaque =
      exr("opaque.exr", [](Image& image) { image.channels["A"].assign(kWidth * kHeight, 1); });
  expect_error(ErrorKind::kInvalidInput, {"opaque.exr has neither"},
               [&] { load_photograph(opaque, {}); });
  PhotographOptions options;
  options.mask = mask("narrow.png", kWidth - 1);
  expect_error(ErrorKind::kInvalidInput, {"the mask", "narrow.png is 59 x 40", "60 x 40"},
               [&] { load_photograph(photo, options); });
  fs::create_directories(folder_.path("empty"));
  options.mask = folder_.path("empty");
  expect_error(ErrorKind::kIo,
               {"there is no mask of " + photo, "photo.png, or another image of that name"},
               [&] { load_photograph(photo, options); });
}

// What is around the object, in a black frame, with a speck in the object: the border is no sign.
TEST_F(PhotographInput, SeesThatAMaskIsInvertedWithinAFrame) {
  std::vector<unsigned char> rgb;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const bool in_frame = x > 0 && y > 0 && x < kWidth - 1 && y < kHeight - 1;
      const bool in_hole = x >= 20 && x < 40 && y >= 12 && y < 28;
      rgb.insert(rgb.end(), 3, in_frame && (!in_hole || (x == 30 && y == 20)) ? 255 : 0);
    }
  }
  PhotographOptions options;
  options.mask = folder_.path("inverted.png");
  write_png(options.mask, kWidth, kHeight, rgb);
  expect_error(ErrorKind::kInvalidInput, {"inverted.png", "13 % in its middle", "is it inverted?"},
               [&] { load_photograph(exr("photo.exr"), options); });
}

// Layers as Blender writes them, with the object where alpha is 1.
TEST_F(PhotographInput, TakesTheAlphaOfItsLayer) {
  const std::string photo = exr("blender.exr", [](Image& image) {
    std::vector<float> alpha;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) alpha.push_back(on_object(x, y) ? 1.0F : 0.0F);
    }
    std::map<std::string, std::vector<float>> channels;
    for (auto& [name, plane] : image.channels) channels["V.Combined." + name] = std::move(plane);
    channels["V.Combined.A"] = std::move(alpha);
    image.channels = {channels.begin(), channels.end()};
  });
  EXPECT_EQ(load_photograph(photo, {}).photograph.mask,
            load_photograph(exr("photo.exr"), with_mask()).photograph.mask);
}

// The card has 0.09 where white would have 0.09 / 0.18.
TEST_F(PhotographInput, MeasuresAGrayCard) {
  PhotographOptions options = with_mask();
  options.gray_card = kCard;
  const PredictInput input = load_photograph(exr("photo.exr"), options);
  ASSERT_EQ(input.capture.white_size(), 3);
  EXPECT_NEAR(input.capture.white(0), 0.5, 1e-6);
  EXPECT_NEAR(input.capture.white(1), 0.5, 1e-6);
  EXPECT_NEAR(input.capture.white(2), 1, 1e-6);
  options.gray = 0.36;
  EXPECT_NEAR(load_photograph(exr("photo.exr"), options).capture.white(0), 0.25, 1e-6);
  options.gray_card = {kLeft - 4, kTop, 8, 4};
  expect_error(ErrorKind::kInvalidInput, {"the gray card 16,12,8,4", "overlaps the object"},
               [&] { load_photograph(exr("photo.exr"), options); });
  options.gray_card = {56, 0, 5, 4};
  expect_error(ErrorKind::kInvalidInput, {"is not inside of its 60 x 40 pixels"},
               [&] { load_photograph(exr("photo.exr"), options); });
  options.gray_card = kCard;
  const std::string dark = exr("dark.exr", [](Image& image) {
    for (float& value : image.channels["G"]) value = value == kOfCard ? 0 : value;
  });
  expect_error(ErrorKind::kInvalidInput, {"is black"}, [&] { load_photograph(dark, options); });
}

// A quarter of the object is white, and it reaches the lower edge.
TEST_F(PhotographInput, SeesWhatIsLost) {
  std::vector<unsigned char> rgb, mask_rgb;
  for (int y = 0; y < kBottom; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const bool clipped = on_object(x, y) && x < kLeft + 5;
      rgb.insert(rgb.end(), 3, clipped ? 255 : to_srgb_byte(kOfObject));
      mask_rgb.insert(mask_rgb.end(), 3, on_object(x, y) ? 255 : 0);
    }
  }
  write_png(folder_.path("photo.png"), kWidth, kBottom, rgb);
  write_png(folder_.path("mask.png"), kWidth, kBottom, mask_rgb);
  PhotographOptions options;
  options.mask = folder_.path("mask.png");
  options.object_size = 40;
  const v1::Capture capture = load_photograph(folder_.path("photo.png"), options).capture;
  EXPECT_TRUE(capture.encoded());
  EXPECT_TRUE(capture.cut_by_frame());
  EXPECT_DOUBLE_EQ(capture.clipped(), 0.25);
  EXPECT_EQ(capture.object_size(), 40);
  // No factor makes radiance of it.
  options.exposure = 3;
  expect_error(ErrorKind::kInvalidInput, {"photo.png", "--radiance-scale", "linear", "--gray-card"},
               [&] { load_photograph(folder_.path("photo.png"), options); });
  options.reading.is_linear = false;  // but if its curve is said
  EXPECT_EQ(load_photograph(folder_.path("photo.png"), options).capture.exposure(), 3);
  options.reading.is_linear.reset();
  write_exr(folder_.path("linear.exr"), read_photograph(folder_.path("photo.png")).image);
  EXPECT_EQ(load_photograph(folder_.path("linear.exr"), options).capture.exposure(), 3);
}

// A linear file that ends below its format's top, and a card that is not one.
TEST_F(PhotographInput, SeesPlateausAndUnevenCards) {
  const std::string photo = exr("photo.exr", [](Image& image) {
    for (auto& [channel, plane] : image.channels) {
      for (size_t p = 0; p < plane.size(); ++p) {
        const bool on = on_object(static_cast<int>(p) % kWidth, static_cast<int>(p) / kWidth);
        plane[p] =
            std::min(on ? 0.7F : 10.0F, plane[p] * (1 + 0.001F * static_cast<float>(p % 977)));
      }
    }
  });
  EXPECT_GT(load_photograph(photo, with_mask()).capture.clipped(), 0.5);
  testing::CapturedLog log;
  PhotographOptions options = with_mask();
  options.gray_card = PixelRectangle{0, 26, 12, 10};
  load_photograph(exr("plain.exr"), options);
  EXPECT_THAT(log.text(), ::testing::HasSubstr("is uneven, by "));
  // Half of it is black.
  const std::string half = exr("half.exr", [](Image& image) {
    for (auto& [channel, plane] : image.channels) {
      for (size_t p = 0; p < plane.size(); ++p) {
        if (p % kWidth < 6 && p / kWidth >= 26) plane[p] = 0;
      }
    }
  });
  expect_error(ErrorKind::kInvalidInput, {"is no card"}, [&] { load_photograph(half, options); });
}

// A veil over the mask, or a photograph that is half transparent, darkens nothing.
TEST_F(PhotographInput, TakesTheBrightestOfAMaskForWhite) {
  const PhotographOptions options = with_gray_mask("veil.png", 160, 0);
  const std::string photo = exr("photo.exr");
  EXPECT_EQ(load_photograph(photo, options).photograph.mask,
            load_photograph(photo, with_mask()).photograph.mask);
}

// Raw developments leave such pixels.
TEST_F(PhotographInput, TakesWhatIsBelowZeroForBlack) {
  const std::string photo = exr("photo.exr", [](Image& image) {
    image.channels["R"][3] = -1e-4F;
    image.channels["G"][7] = -0.5F;
  });
  testing::CapturedLog log;
  const PredictInput input = load_photograph(photo, with_mask());
  EXPECT_THAT(log.text(), ::testing::HasSubstr("2 values are below 0, the least -0.5"));
  EXPECT_GE(std::ranges::min(input.photograph.pixels), 0);
}

TEST_F(PhotographInput, TakesTheLayerAndTheEncodingThatAreSaid) {
  const std::string photo = exr("photo.exr", [](Image& image) {
    for (const char* channel : {"R", "G", "B"}) {
      image.channels[std::string("half.") + channel] = image.channels[channel];
      for (float& value : image.channels[std::string("half.") + channel]) value /= 2;
    }
  });
  PhotographOptions options = with_mask();
  const float whole = load_photograph(photo, options).photograph.pixels[0];
  options.reading.layer = "half";
  EXPECT_FLOAT_EQ(load_photograph(photo, options).photograph.pixels[0], whole / 2);
  std::vector<unsigned char> gray(3 * kWidth * kHeight, 128);
  write_png(folder_.path("gray.png"), kWidth, kHeight, gray);
  options.reading = {.is_linear = true, .layer = ""};
  const PredictInput linear = load_photograph(folder_.path("gray.png"), options);
  EXPECT_FLOAT_EQ(linear.photograph.pixels[0], 128 / 255.0F);
  EXPECT_FALSE(linear.capture.encoded());
}

TEST_F(PhotographInput, NamesMasksOfLabels) {
  const PhotographOptions options = with_gray_mask("labels.png", 1, 0);
  expect_error(ErrorKind::kInvalidInput, {"labels.png is black", "(1 of 255)", "mask of labels"},
               [&] { load_photograph(exr("photo.exr"), options); });
}

// Gray on the object, as a soft brush leaves it, and the wrong way round.
TEST_F(PhotographInput, TakesSoftMasksAndRefusesInvertedOnes) {
  const std::string photo = exr("photo.exr");
  const auto with = [&](unsigned char on, unsigned char off) {
    const PhotographOptions options = with_gray_mask("soft.png", on, off);
    return load_photograph(photo, options).photograph;
  };
  EXPECT_EQ(with(100, 0).mask, load_photograph(photo, with_mask()).photograph.mask);
  for (const int on : {0, 255}) {
    expect_error(ErrorKind::kInvalidInput, {"soft.png covers", "inverted"},
                 [&] { with(static_cast<unsigned char>(on), 255); });
  }
  expect_error(ErrorKind::kInvalidInput, {"photo.exr"}, [&] { with(0, 0); });
}

TEST_F(PhotographInput, OfFoldersAllPhotographsAreMeantByName) {
  for (const char* name : {"b.PNG", "a.jpg", "c.exr", "notes.txt"}) folder_.write(name, "");
  EXPECT_THAT(photograph_files({folder_.path(""), "other.exr"}),
              ElementsAre(folder_.path("a.jpg"), folder_.path("b.PNG"), folder_.path("c.exr"),
                          "other.exr"));
  fs::create_directories(folder_.path("none"));
  expect_error(ErrorKind::kIo, {"there is no photograph (.exr"},
               [&] { photograph_files({folder_.path("none")}); });
}

}  // namespace
}  // namespace itn
