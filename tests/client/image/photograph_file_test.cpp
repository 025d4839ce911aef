#include "client/image/photograph_file.h"

#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "client/image/image_format.h"
#include "client/image/srgb.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "tests/support/address_space.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

#ifdef __SANITIZE_ADDRESS__
// The encoder of HEIC that the tests write with does not free what it allocates once.
extern "C" const char* __lsan_default_suppressions() {  // NOLINT(bugprone-reserved-identifier)
  return "leak:x265_malloc\n";
}
#endif

namespace itn {
namespace {

using namespace std::string_literals;
using namespace testing;

// --- Files of every format, by other programs' libraries ---

struct Content {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<uint16_t> values;  // of 16 bits; brought to fewer where the file has fewer
};

std::string big(uint32_t value, int bytes = 4) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text.push_back(static_cast<char>(value >> (8 * i) & 0xffU));
  return text;
}

// The file that OpenImageIO writes: `format` is its extension.
std::string encoded(const Content& content, const std::string& format,
                    OIIO::TypeDesc type = OIIO::TypeDesc::UINT8,
                    const std::vector<std::pair<std::string, float>>& attributes = {}) {
  const TemporaryFolder folder;
  const std::string path = folder.path("a." + format);
  OIIO::ImageSpec spec(content.width, content.height, content.channels, type);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  spec.attribute("CompressionQuality", 100);
  spec.attribute("jpeg:subsampling", "4:4:4");
  for (const auto& [name, value] : attributes) {
    const bool whole = name == "Orientation" || name.starts_with("Exif:");
    if (whole) {
      spec.attribute(name, static_cast<int>(value));
    } else {
      spec.attribute(name, value);
    }
  }
  const auto output = OIIO::ImageOutput::create(path);
  EXPECT_TRUE(output && output->open(path, spec) &&
              output->write_image(OIIO::TypeDesc::UINT16, content.values.data()) && output->close())
      << (output ? output->geterror() : OIIO::geterror());
  return read_file(path, "image");
}

constexpr uint16_t of_byte(int byte) {
  return static_cast<uint16_t>(257 * byte);
}

// All pixels different, none at the top, and smooth: what loses something loses little of it.
Content ramp(int width, int height, int channels) {
  Content content{width, height, channels, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        content.values.push_back(of_byte(20 + 200 * x / width + 20 * y / height + 3 * c));
      }
    }
  }
  return content;
}

// A PNG by libpng itself, of any kind. `rows` are in its own layout.
std::string png_of(int width, int height, int bits, int kind, const std::vector<uint8_t>& bytes,
                   double gamma = 0, const std::vector<png_color>& palette = {}) {
  std::string out;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(
      png, &out,
      [](png_structp p, png_bytep data, size_t size) {
        static_cast<std::string*>(png_get_io_ptr(p))
            ->append(reinterpret_cast<const char*>(data), size);
      },
      nullptr);
  png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), bits,
               kind, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  if (gamma > 0) png_set_gAMA(png, info, gamma);
  if (!palette.empty()) png_set_PLTE(png, info, palette.data(), static_cast<int>(palette.size()));
  png_write_info(png, info);
  const size_t row = bytes.size() / static_cast<size_t>(height);
  for (size_t y = 0; y < static_cast<size_t>(height); ++y) png_write_row(png, &bytes[y * row]);
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  return out;
}

float linear(int byte) {
  return static_cast<float>(linear_of_srgb(byte / 255.0));
}

PhotographFile decode(const std::string& bytes) {
  return decode_photograph(bytes, "photo");
}

// --- What is in files ---

struct FormatRow {
  const char* name;
  const char* extension;
  OIIO::TypeDesc type;
  int channels;
  bool encoded;
  double tolerance;  // of encoded values, in 255ths
};

const std::vector<FormatRow> kFormats{
    {"png", "png", OIIO::TypeDesc::UINT8, 3, true, 0},
    {"png_gray", "png", OIIO::TypeDesc::UINT8, 1, true, 0},
    {"png_alpha", "png", OIIO::TypeDesc::UINT8, 4, true, 0},
    {"png_gray_alpha", "png", OIIO::TypeDesc::UINT8, 2, true, 0},
    {"png_16", "png", OIIO::TypeDesc::UINT16, 3, true, 0},
    {"jpeg", "jpg", OIIO::TypeDesc::UINT8, 3, true, 2},
    {"jpeg_gray", "jpg", OIIO::TypeDesc::UINT8, 1, true, 2},
    {"tiff", "tif", OIIO::TypeDesc::UINT8, 3, true, 0},
    {"tiff_gray", "tif", OIIO::TypeDesc::UINT8, 1, true, 0},
    {"tiff_alpha", "tif", OIIO::TypeDesc::UINT8, 4, true, 0},
    {"tiff_16", "tif", OIIO::TypeDesc::UINT16, 3, true, 0},
    {"tiff_float", "tif", OIIO::TypeDesc::FLOAT, 3, false, 0},
    {"hdr", "hdr", OIIO::TypeDesc::FLOAT, 3, false, 1},
    {"webp", "webp", OIIO::TypeDesc::UINT8, 3, true, 4},
    {"heic", "heic", OIIO::TypeDesc::UINT8, 3, true, 6},
};

class FormatTest : public ::testing::TestWithParam<FormatRow> {
 protected:
  // The sides are above 64 x 48, and above 64 x 64 for the blocks of HEIC.
  Content content_ = ramp(80, 72, GetParam().channels);
  std::string bytes_ = encoded(content_, GetParam().extension, GetParam().type);
};

TEST_P(FormatTest, IsRead) {
  const FormatRow& format = GetParam();
  const PhotographFile file = decode(bytes_);
  EXPECT_EQ(file.encoded, format.encoded);
  ASSERT_EQ(file.image.width, 80);
  ASSERT_EQ(file.image.height, 72);
  const bool alpha = format.channels % 2 == 0;
  EXPECT_EQ(file.image.channels.size(), static_cast<size_t>(format.channels));
  for (int c = 0; c < format.channels; ++c) {
    const bool is_alpha = alpha && c == format.channels - 1;
    const std::string name = is_alpha ? "A" : format.channels < 3 ? "Y" : std::string(1, "RGB"[c]);
    const std::vector<float>& plane = file.image.channel(name);
    for (size_t i = 0; i < plane.size(); ++i) {
      const size_t channels = static_cast<size_t>(format.channels);
      const double value = content_.values[i * channels + static_cast<size_t>(c)] / 65535.0;
      const bool curve = format.encoded && !is_alpha;
      const double lower = value - format.tolerance / 255, upper = value + format.tolerance / 255;
      ASSERT_GE(plane[i], (curve ? linear_of_srgb(lower) : lower) - 1e-6) << name << " " << i;
      ASSERT_LE(plane[i], (curve ? linear_of_srgb(upper) : upper) + 1e-6) << name << " " << i;
    }
  }
  EXPECT_EQ(file.clipped.size(), format.encoded ? 80 * 72U : 0U);
  EXPECT_EQ(std::accumulate(file.clipped.begin(), file.clipped.end(), 0), 0);
}

// Cut short anywhere, a file is an error and says so; but for what lies behind the last pixel.
TEST_P(FormatTest, CutShortIsAnError) {
  const size_t behind_the_pixels = 16;
  for (const double part : {0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95}) {
    const auto size = static_cast<size_t>(part * static_cast<double>(bytes_.size()));
    if (bytes_.size() - size <= behind_the_pixels) continue;
    SCOPED_TRACE(size);
    try {
      decode(bytes_.substr(0, size));
      ADD_FAILURE() << "it was read";
    } catch (const Error& error) {
      // Nobody can tell what two or three bytes were the beginning of.
      EXPECT_TRUE(size <= 16 || error.kind() == ErrorKind::kDataLoss) << error.what();
      EXPECT_THAT(error.what(), ::testing::HasSubstr("photo"));
    }
  }
}

// Bytes changed anywhere: an error or another image, and nothing else; nothing on stderr, either.
TEST_P(FormatTest, DamageIsAnErrorOrAnotherImage) {
  std::mt19937 random(1);
  ::testing::internal::CaptureStderr();
  for (int i = 0; i < 300; ++i) {
    std::string bytes = bytes_;
    const size_t part = i % 2 == 0 ? std::min<size_t>(bytes.size(), 128) : bytes.size();
    for (int k = 0; k <= i % 4; ++k) bytes[random() % part] = static_cast<char>(random());
    try {
      const PhotographFile file = decode(bytes);
      EXPECT_GT(file.image.channels.size(), 0U);
    } catch (const Error& error) {
      EXPECT_NE(exit_code(error.kind()), 1) << error.what();
    }
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

INSTANTIATE_TEST_SUITE_P(Table, FormatTest, ::testing::ValuesIn(kFormats),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(PhotographFile, ExrIsReadAsItIs) {
  const TemporaryFolder folder;
  Image image{
      .width = 2, .height = 1, .channels = {{"Y", {1, 2}}, {"mask.Y", {0, 1}}}, .attributes = {}};
  write_exr(folder.path() / "a.exr", image);
  const PhotographFile file = read_photograph(folder.path() / "a.exr");
  EXPECT_EQ(file.image.channels, image.channels);
  EXPECT_FALSE(file.encoded);
  EXPECT_TRUE(file.clipped.empty());
}

// Its name says nothing.
TEST(PhotographFile, IsToldByItsContent) {
  const TemporaryFolder folder;
  const auto path = folder.write("a.exr", encoded(ramp(4, 3, 3), "png"));
  EXPECT_EQ(read_photograph(path).image.width, 4);
}

TEST(PhotographFile, AlphaDoesNotDimColours) {
  for (const char* format : {"png", "tif", "heic"}) {
    Content content{64, 64, 4, {}};
    for (int i = 0; i < 64 * 64; ++i) {
      for (const int v : {200, 100, 50, 128}) content.values.push_back(of_byte(v));
    }
    const PhotographFile file = decode(encoded(content, format));
    const float tolerance = format == "heic"s ? 0.03F : 1e-6F;
    EXPECT_NEAR(file.image.channel("R")[9], linear(200), tolerance) << format;
    EXPECT_NEAR(file.image.channel("B")[9], linear(50), tolerance) << format;
    EXPECT_NEAR(file.image.channel("A")[9], 128 / 255.0F, tolerance) << format;
  }
}

// A TIFF whose colours are multiplied by alpha.
TEST(PhotographFile, DividesColoursByTheirAlpha) {
  const TemporaryFolder folder;
  const std::string path = folder.path("a.tif");
  OIIO::ImageSpec spec(2, 1, 4, OIIO::TypeDesc::UINT8);
  const auto output = OIIO::ImageOutput::create(path);
  const std::array<uint8_t, 8> values{100, 50, 25, 128, 0, 0, 0, 0};
  ASSERT_TRUE(output->open(path, spec) &&
              output->write_image(OIIO::TypeDesc::UINT8, values.data()) && output->close());
  const PhotographFile file = read_photograph(path);
  EXPECT_FLOAT_EQ(file.image.channel("R")[0], linear(199));
  EXPECT_FLOAT_EQ(file.image.channel("G")[0], linear(100));
  EXPECT_FLOAT_EQ(file.image.channel("R")[1], 0);
  EXPECT_FLOAT_EQ(file.image.channel("A")[0], 128 / 255.0F);
}

// A smaller copy of the first page is none of its own.
TEST(PhotographFile, ReadsTheFirstPageAndSaysSo) {
  const TemporaryFolder folder;
  const std::string path = folder.path("a.tif");
  OIIO::ImageSpec spec(1, 1, 1, OIIO::TypeDesc::UINT8);
  const auto read_pages = [&](int pages, bool is_reduced) {
    const auto output = OIIO::ImageOutput::create(path);
    for (int page = 0; page < pages; ++page) {
      const auto value = static_cast<uint8_t>(10 + page);
      spec.attribute("tiff:subfiletype", is_reduced && page > 0 ? 1 : 0);
      EXPECT_TRUE(
          output->open(path, spec,
                       page == 0 ? OIIO::ImageOutput::Create : OIIO::ImageOutput::AppendSubimage) &&
          output->write_image(OIIO::TypeDesc::UINT8, &value));
    }
    output->close();
    testing::CapturedLog log;
    EXPECT_FLOAT_EQ(read_photograph(path).image.channel("Y")[0], linear(10));
    return log.text();
  };
  EXPECT_THAT(read_pages(3, false), ::testing::HasSubstr("a.tif has 3 pages; the first is read"));
  EXPECT_EQ(read_pages(2, true), "");
  EXPECT_EQ(read_pages(1, false), "");
}

TEST(PhotographFile, ReadsPalettesAndFewBits) {
  const PhotographFile palette = decode(png_of(4, 1, 2, PNG_COLOR_TYPE_PALETTE, {0b00'01'10'00}, 0,
                                               {{10, 20, 30}, {40, 50, 60}, {70, 80, 90}}));
  EXPECT_FLOAT_EQ(palette.image.channel("R")[1], linear(40));
  EXPECT_FLOAT_EQ(palette.image.channel("B")[2], linear(90));
  const PhotographFile bits = decode(png_of(8, 1, 1, PNG_COLOR_TYPE_GRAY, {0b0101'0000}));
  EXPECT_EQ(bits.image.channel("Y"), (std::vector<float>{0, 1, 0, 1, 0, 0, 0, 0}));
}

TEST(PhotographFile, BelievesAFileThatSaysItIsLinear) {
  const std::string bytes = png_of(2, 1, 8, PNG_COLOR_TYPE_GRAY, {51, 102}, 1.0);
  const PhotographFile file = decode(bytes);
  EXPECT_FALSE(file.encoded);
  EXPECT_FLOAT_EQ(file.image.channel("Y")[0], 0.2F);
  EXPECT_TRUE(decode(png_of(2, 1, 8, PNG_COLOR_TYPE_GRAY, {51, 102}, 1 / 2.2)).encoded);
  const PhotographFile power = decode(png_of(2, 1, 8, PNG_COLOR_TYPE_GRAY, {51, 102}, 1 / 1.8));
  EXPECT_TRUE(power.encoded);
  EXPECT_NEAR(power.image.channel("Y")[0], std::pow(0.2, 1.8), 1e-5);
  expect_error(ErrorKind::kInvalidInput, {"photo", "a gamma of 10.00"}, [] {
    decode(png_of(2, 1, 8, PNG_COLOR_TYPE_GRAY, {51, 102}, 0.1));
  });
}

// The way of Radiance: the first axis is that of the lines, values were multiplied by the exposure.
TEST(PhotographFile, ReadsRadianceAsItIsMeant) {
  const auto of = [](const std::string& size, const std::string& header = "") {
    std::string bytes = "#?RADIANCE\n" + header + "FORMAT=32-bit_rle_rgbe\n\n" + size + "\n";
    for (int value = 1; value <= 6; ++value) {
      bytes += {static_cast<char>(40 * value), 1, 2, static_cast<char>(128)};
    }
    return decode(bytes).image;
  };
  const auto first = [](const Image& image) {
    return std::lround(image.channel("R").front() * 256 / 40);
  };
  const Image upright = of("-Y 2 +X 3");
  EXPECT_FLOAT_EQ(upright.channel("R")[5], 240.5F / 256);
  EXPECT_EQ(upright.width, 3);
  struct Row {
    const char* size;
    int width, first;
  };
  for (const Row& row : {Row{"-Y 2 -X 3", 3, 3}, Row{"+Y 2 +X 3", 3, 4}, Row{"+Y 2 -X 3", 3, 6},
                         Row{"+X 2 -Y 3", 2, 1}, Row{"-X 2 -Y 3", 2, 4}, Row{"+X 2 +Y 3", 2, 3},
                         Row{"-X 2 +Y 3", 2, 6}}) {
    const Image image = of(row.size);
    EXPECT_EQ(image.width, row.width) << row.size;
    EXPECT_EQ(first(image), row.first) << row.size;
  }
  const Image exposed = of("-Y 2 +X 3", "EXPOSURE=0.5\nEXPOSURE= 4\nCOLORCORR=1 2 1\n");
  EXPECT_FLOAT_EQ(exposed.channel("R")[5], 240.5F / 512);
  EXPECT_FLOAT_EQ(exposed.channel("G")[5], 1.5F / 1024);
  of("-Y 2 +X 3", "PRIMARIES=0.640 0.330 0.290 0.600 0.150 0.060 0.333 0.333\nPIXASPECT=1.0\n");
  of("-Y 2 +X 3", "PRIMARIES= .64 .33 .3 .6 .15 .06 .3127 .329\n");
  expect_error(ErrorKind::kInvalidInput, {"photo", "other primaries"}, [&] {
    of("-Y 2 +X 3", "PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290\n");
  });
  expect_error(ErrorKind::kInvalidInput, {"photo", "not square"},
               [&] { of("-Y 2 +X 3", "PIXASPECT=2\n"); });
  expect_error(ErrorKind::kInvalidInput, {"photo", "GAMMA"},
               [&] { of("-Y 2 +X 3", "GAMMA=2.2\n"); });
}

TEST(PhotographFile, MarksWhatIsAtTheTop) {
  const auto clipped = [](const std::vector<uint8_t>& bytes, int bits) {
    const int width = static_cast<int>(bytes.size()) / (bits / 8) / 3;
    return decode(png_of(width, 1, bits, PNG_COLOR_TYPE_RGB, bytes)).clipped;
  };
  using Flags = std::vector<unsigned char>;
  EXPECT_EQ(clipped({1, 2, 253, 0, 254, 0, 255, 255, 255}, 8), (Flags{0, 1, 1}));
  EXPECT_EQ(clipped({0xff, 0xef, 0, 0, 0, 0, 0xff, 0xf0, 0, 0, 0, 0}, 16), (Flags{0, 1}));
  EXPECT_EQ(decode(png_of(1, 1, 8, PNG_COLOR_TYPE_GRAY_ALPHA, {3, 255})).clipped, Flags{0});
}

// Row by row what an upright 3 x 2 image 1 2 3 / 4 5 6 is in a file of each orientation.
TEST(PhotographFile, BringsEveryOrientationUpright) {
  struct Row {
    int orientation, width;
    std::vector<int> values;
  };
  const std::vector<Row> rows{{1, 3, {1, 2, 3, 4, 5, 6}}, {2, 3, {3, 2, 1, 6, 5, 4}},
                              {3, 3, {6, 5, 4, 3, 2, 1}}, {4, 3, {4, 5, 6, 1, 2, 3}},
                              {5, 2, {1, 4, 2, 5, 3, 6}}, {6, 2, {3, 6, 2, 5, 1, 4}},
                              {7, 2, {6, 3, 5, 2, 4, 1}}, {8, 2, {4, 1, 5, 2, 6, 3}}};
  for (const Row& row : rows) {
    SCOPED_TRACE(row.orientation);
    Content content{row.width, 6 / row.width, 1, {}};
    for (const int value : row.values)
      content.values.push_back(of_byte(value == 6 ? 255 : 40 * value));
    const std::string bytes = encoded(content, "tif", OIIO::TypeDesc::UINT8,
                                      {{"Orientation", static_cast<float>(row.orientation)}});
    const PhotographFile file = decode(bytes);
    ASSERT_EQ(file.image.width, 3);
    ASSERT_EQ(file.image.height, 2);
    for (size_t i = 0; i < 5; ++i) {
      EXPECT_FLOAT_EQ(file.image.channel("Y")[i], linear(40 * static_cast<int>(i + 1)));
    }
    EXPECT_EQ(file.clipped, (std::vector<unsigned char>{0, 0, 0, 0, 0, 1}));
    EXPECT_FLOAT_EQ(decode_mask(bytes, "m").values[1], 80 / 255.0F);
  }
}

TEST(PhotographFile, BringsAJpegUpright) {
  const PhotographFile file =
      decode(encoded(ramp(80, 40, 3), "jpg", OIIO::TypeDesc::UINT8, {{"Orientation", 6.0F}}));
  EXPECT_EQ(file.image.width, 40);
  EXPECT_EQ(file.image.height, 80);
  // The file's left, which is dark, is on top.
  EXPECT_LT(file.image.channel("R")[20], file.image.channel("R")[20 + 79 * 40]);
}

TEST(PhotographFile, ReadsWhatTheCameraSays) {
  for (const char* format : {"jpg", "tif", "heic"}) {
    SCOPED_TRACE(format);
    std::string bytes = encoded(
        ramp(64, 64, 3), format, OIIO::TypeDesc::UINT8,
        {{"ExposureTime", 0.0125F}, {"FNumber", 2.8F}, {"Exif:PhotographicSensitivity", 200.0F}});
    // It leaves out where the header of HEIC is, which is behind these six letters.
    const size_t exif = bytes.find("Exif\0\0MM"s);
    if (format == "heic"s) bytes.replace(exif - 4, 4, big(6));
    const PhotographFile file = decode(bytes);
    EXPECT_NEAR(file.exposure_seconds.value_or(0), 0.0125, 1e-6);
    EXPECT_NEAR(file.f_number.value_or(0), 2.8, 1e-6);
    // OpenImageIO does not write it into TIFF.
    EXPECT_EQ(file.iso.value_or(0), format == "tif"s ? 0 : 200);
  }
  const PhotographFile silent = decode(encoded(ramp(64, 64, 3), "jpg"));
  EXPECT_FALSE(silent.exposure_seconds || silent.f_number || silent.iso);
  EXPECT_FALSE(
      decode(encoded(ramp(64, 64, 3), "jpg", OIIO::TypeDesc::UINT8, {{"ExposureTime", 0.0F}}))
          .exposure_seconds);
}

// --- Files by hand ---

// A PNG of a header alone.
std::string png_claim(uint32_t width, uint32_t height) {
  return "\x89PNG\r\n\x1a\n"s + big(13) + "IHDR" + big(width) + big(height) + "\x10\x06\0\0\0"s +
         big(0) + big(0) + "IDAT" + big(0);
}

std::string jpeg_claim(uint32_t width, uint32_t height, int components, int marker = 0xc2) {
  std::string bytes = "\xff\xd8\xff"s + static_cast<char>(marker) + big(8 + 3 * components, 2) +
                      "\x08" + big(height, 2) + big(width, 2) + static_cast<char>(components);
  for (int i = 1; i <= components; ++i) bytes += static_cast<char>(i) + "\x11\0"s;
  return bytes + "\xff\xda\0\x08\x01\x01\0\0\x3f\0\xff\xd9"s;
}

struct Tag {
  uint32_t number, type, count, value;
};

std::string tiff_of(const std::vector<Tag>& tags, const std::string& data = {}) {
  std::string bytes = "MM\0*"s + big(8) + big(static_cast<uint32_t>(tags.size()), 2);
  for (const Tag& tag : tags) {
    bytes += big(tag.number, 2) + big(tag.type, 2) + big(tag.count) +
             (tag.type == 3 && tag.count == 1 ? big(tag.value, 2) + big(0, 2) : big(tag.value));
  }
  return bytes + big(0) + data;
}

std::string tiff_claim(uint32_t width, uint32_t height, std::vector<Tag> more = {}) {
  std::vector<Tag> tags{{256, 4, 1, width}, {257, 4, 1, height}, {258, 3, 1, 8},
                        {259, 3, 1, 1},     {262, 3, 1, 1},      {277, 3, 1, 1}};
  tags.insert(tags.end(), more.begin(), more.end());
  std::ranges::sort(tags, {}, &Tag::number);
  return tiff_of(tags);
}

std::string webp_claim(uint32_t bits) {
  std::string header;
  for (int i = 0; i < 4; ++i) header.push_back(static_cast<char>(bits >> (8 * i) & 0xffU));
  return "RIFF\x12\0\0\0WEBPVP8L\5\0\0\0/"s + header + "\0"s;
}

std::string heic_claim(uint32_t width, uint32_t height) {
  const std::string ispe = big(20) + "ispe" + big(0) + big(width) + big(height);
  return big(24) + "ftypheic" + big(0) + "mif1heic" + big(8 + 20) + "meta" + ispe;
}

struct BadFile {
  const char* name;
  std::string bytes;
  ErrorKind kind;
  std::vector<std::string> message;
};

template <typename T>
std::string float_tiff(T value) {
  const TemporaryFolder folder;
  const std::string path = folder.path("a.tif");
  std::vector<T> values(5 * 4 * 3, T{1});
  values[3 * (2 + 5 * 3) + 1] = value;
  const auto output = OIIO::ImageOutput::create(path);
  output->open(path, OIIO::ImageSpec(5, 4, 3, OIIO::BaseTypeFromC<T>::value));
  output->write_image(OIIO::BaseTypeFromC<T>::value, values.data());
  output->close();
  return read_file(path, "image");
}

const std::vector<BadFile> kBadFiles{
    {"empty", "", ErrorKind::kDataLoss, {"photo is empty"}},
    {"noise",
     "\x01\x02\x03\x80\x90\x04\x05\x06"s,
     ErrorKind::kDataLoss,
     {"does not begin as any image"}},
    {"text", "Dear Sir or Madam,\n", ErrorKind::kInvalidInput, {"photo is text", "JPEG"}},
    {"pdf", "%PDF-1.7\n%\xe2\xe3", ErrorKind::kInvalidInput, {"photo is a PDF document", "JPEG"}},
    {"gif", "GIF89a\x01\0\x01\0"s, ErrorKind::kInvalidInput, {"photo is a GIF image", "JPEG"}},
    {"film", big(20) + "ftypmp42"s, ErrorKind::kInvalidInput, {"photo is a film"}},
    {"raw_of_canon", "II*\0\x10\0\0\0CR\x02\0"s, ErrorKind::kInvalidInput, {"camera's raw"}},
    {"raw_dng",
     tiff_claim(100, 100, {{50706, 1, 4, 0x01040000}}),
     ErrorKind::kInvalidInput,
     {"camera's raw data", "develop it"}},
    {"raw_of_nikon",
     tiff_claim(160, 120, {{254, 4, 1, 1}}),
     ErrorKind::kInvalidInput,
     {"camera's raw data", "thumbnail", "save the image alone"}},
    {"cmyk_jpeg", jpeg_claim(64, 64, 4), ErrorKind::kInvalidInput, {"CMYK", "save it as RGB"}},
    {"cmyk_tiff",
     tiff_of({{256, 4, 1, 9}, {257, 4, 1, 9}, {262, 3, 1, 5}}),
     ErrorKind::kInvalidInput,
     {"CMYK"}},
    {"lossless_jpeg", jpeg_claim(64, 64, 3, 0xc3), ErrorKind::kInvalidInput, {"without loss"}},
    {"webp_with_alpha", webp_claim(1U << 28U), ErrorKind::kInvalidInput, {"with alpha", "PNG"}},
    {"nan",
     float_tiff(std::numeric_limits<float>::quiet_NaN()),
     ErrorKind::kInvalidInput,
     {"channel G is nan at pixel x = 2, y = 3"}},
    {"infinite",
     float_tiff(std::numeric_limits<float>::infinity()),
     ErrorKind::kInvalidInput,
     {"channel G is inf at pixel x = 2, y = 3"}},
    {"tiff_of_32_bits",
     float_tiff(uint32_t{7}),
     ErrorKind::kInvalidInput,
     {"of type uint;", "8 or 16 bits"}},
    // Files of absurd size: a header and next to nothing behind it.
    {"png_of_exabytes",
     png_claim(1'000'000'000, 1'000'000'000),
     ErrorKind::kInvalidInput,
     {"1000000000 x 1000000000 pixels", "16384 x 16384"}},
    {"png_of_gigabytes",
     png_claim(16384, 16384),
     ErrorKind::kDataLoss,
     {"claims 16384 x 16384 pixels, the file has"}},
    {"png_of_nothing", png_claim(0, 5), ErrorKind::kDataLoss, {"no pixels"}},
    {"jpeg_of_gigabytes", jpeg_claim(65500, 65500, 3), ErrorKind::kInvalidInput, {"65500 x 65500"}},
    {"jpeg_of_megabytes", jpeg_claim(16384, 16384, 3), ErrorKind::kDataLoss, {"16384 x 16384"}},
    {"tiff_of_exabytes", tiff_claim(0x7fffffff, 0x7fffffff), ErrorKind::kInvalidInput, {"16384"}},
    {"tiff_of_gigabytes", tiff_claim(16384, 16384), ErrorKind::kDataLoss, {"16384 x 16384"}},
    {"tiff_of_many_channels",
     tiff_of({{256, 4, 1, 9}, {257, 4, 1, 9}, {262, 3, 1, 1}, {277, 3, 1, 65535}}),
     ErrorKind::kDataLoss,
     {"65535 channels"}},
    // Strips: one that would be four gigabytes, and four billion of them.
    {"tiff_of_a_huge_strip",
     tiff_claim(100, 100, {{273, 4, 1, 8}, {278, 4, 1, 0xffffffff}, {279, 4, 1, 0xffffffff}}),
     ErrorKind::kDataLoss,
     {"photo"}},
    {"tiff_of_many_strips",
     tiff_claim(100, 100, {{273, 4, 0xffffffff, 8}, {278, 4, 1, 1}, {279, 4, 0xffffffff, 8}}),
     ErrorKind::kDataLoss,
     {"photo"}},
    {"tiff_of_huge_tiles",
     tiff_claim(100, 100,
                {{322, 4, 1, 0x7ffffff0}, {323, 4, 1, 0x7ffffff0}, {324, 4, 1, 8}, {325, 4, 1, 8}}),
     ErrorKind::kDataLoss,
     {"tiles larger than any image"}},
    {"hdr_of_gigabytes",
     "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n",
     ErrorKind::kDataLoss,
     {"16384 x 16384"}},
    {"hdr_of_another_space",
     "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 4 +X 4\n",
     ErrorKind::kInvalidInput,
     {"save it as RGB"}},
    {"webp_of_gigabytes", webp_claim(0x0fffffff), ErrorKind::kDataLoss, {"16384 x 16384"}},
    {"heic_of_exabytes", heic_claim(0x7fffffff, 0x7fffffff), ErrorKind::kInvalidInput, {"16384"}},
    {"heic_of_gigabytes", heic_claim(16384, 16384), ErrorKind::kDataLoss, {"16384 x 16384"}},
    {"damaged_exr", "\x76\x2f\x31\x01\x02\0\0\0"s, ErrorKind::kDataLoss, {"OpenEXR"}},
};

class BadPhotographTest : public ::testing::TestWithParam<BadFile> {};

// In no more memory than is always there.
TEST_P(BadPhotographTest, IsRefused) {
  decode(encoded(ramp(4, 4, 3), "tif"));  // loads what takes address space once
  const AddressSpaceLimit limit(size_t{200} << 20U);
  expect_error(GetParam().kind, GetParam().message, [&] { decode(GetParam().bytes); });
}

INSTANTIATE_TEST_SUITE_P(Table, BadPhotographTest, ::testing::ValuesIn(kBadFiles),
                         [](const auto& row) { return std::string(row.param.name); });

// A file that deflate has made 1,000 times smaller takes what its pixels take, and no more.
TEST(PhotographFile, ABombTakesWhatItsPixelsTake) {
  const std::string bytes =
      png_of(4096, 4096, 8, PNG_COLOR_TYPE_RGB, std::vector<uint8_t>(size_t{3} * 4096 * 4096, 7));
  EXPECT_LT(bytes.size(), 100'000U);
  const size_t pixels = size_t{4096} * 4096;
  const AddressSpaceLimit limit(pixels * (3 + 3 * sizeof(float) + 1) + (size_t{32} << 20U));
  EXPECT_FLOAT_EQ(decode(bytes).image.channel("B").back(), linear(7));
}

// --- Masks ---

TEST(MaskFile, IsTheValueWithoutACurve) {
  Content content{4, 1, 1, {0, 32768, of_byte(51), 65535}};
  for (const char* format : {"png", "tif"}) {
    const MaskFile mask = decode_mask(encoded(content, format, OIIO::TypeDesc::UINT16), "m");
    EXPECT_EQ(mask.width, 4);
    EXPECT_EQ(mask.height, 1);
    EXPECT_FLOAT_EQ(mask.values[1], 32768 / 65535.0F);
    EXPECT_FLOAT_EQ(mask.values[2], 0.2F);
    EXPECT_FLOAT_EQ(mask.values[3], 1);
  }
}

TEST(MaskFile, IsTheAlphaThatVaries) {
  const MaskFile mask =
      decode_mask(png_of(2, 1, 8, PNG_COLOR_TYPE_RGBA, {1, 2, 3, 0, 4, 5, 6, 255}), "m");
  EXPECT_EQ(mask.values, (std::vector<float>{0, 1}));
  const MaskFile opaque =
      decode_mask(png_of(2, 1, 8, PNG_COLOR_TYPE_RGBA, {255, 255, 255, 255, 0, 0, 0, 255}), "m");
  EXPECT_EQ(opaque.values, (std::vector<float>{1, 0}));
}

TEST(MaskFile, IsGray) {
  EXPECT_EQ(decode_mask(png_of(2, 1, 8, PNG_COLOR_TYPE_RGB, {255, 255, 255, 0, 0, 0}), "m").values,
            (std::vector<float>{1, 0}));
  EXPECT_EQ(decode_mask(png_of(8, 1, 1, PNG_COLOR_TYPE_GRAY, {0b1100'0000}), "m").values,
            (std::vector<float>{1, 1, 0, 0, 0, 0, 0, 0}));
  expect_error(
      ErrorKind::kInvalidInput, {"the mask m.png has colours", "x = 1, y = 0", "gray"}, [] {
        decode_mask(png_of(2, 1, 8, PNG_COLOR_TYPE_RGB, {255, 255, 255, 0, 9, 0}), "m.png");
      });
}

TEST(MaskFile, OfAnExrIsItsMaskChannel) {
  const TemporaryFolder folder;
  write_exr(folder.path() / "a.exr", {.width = 2,
                                      .height = 1,
                                      .channels = {{"Y", {5, 6}}, {"mask.Y", {0, 0.5F}}},
                                      .attributes = {}});
  const MaskFile mask = read_mask(folder.path() / "a.exr");
  EXPECT_EQ(mask.values, (std::vector<float>{0, 0.5F}));
  EXPECT_EQ(mask.width, 2);
}

TEST(MaskFile, ThatIsDamagedIsCalledTheMask) {
  const std::string png = encoded(ramp(30, 30, 1), "png");
  for (const std::string& bytes :
       {png.substr(0, png.size() / 2), "\x76\x2f\x31\x01\x02\0\0\0"s, ""s}) {
    expect_error(ErrorKind::kDataLoss, {"the mask m"}, [&] { decode_mask(bytes, "m"); });
  }
}

}  // namespace
}  // namespace itn
