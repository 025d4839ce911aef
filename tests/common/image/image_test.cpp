#include "common/image/image.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <gtest/gtest.h>
#include <half.h>
#include <png.h>

#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <numeric>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using testing::expect_error;
using testing::TemporaryFolder;

// Every value different, of a size that is no multiple of the 16 rows of a ZIP block.
Image sample_image() {
  Image image;
  image.width = 7;
  image.height = 37;
  for (const char* name : {"Y", "sigma_t.Y", "mask.Y"}) {
    std::vector<float>& plane = image.channels[name];
    plane.resize(7 * 37);
    std::iota(plane.begin(), plane.end(), static_cast<float>(image.channels.size()) / 3);
  }
  image.attributes = {{"itn:material", "sigma_t: 100 albedo: 0.9"}, {"note", ""}};
  return image;
}

TEST(Exr, ReadsBackWhatWasWritten) {
  const TemporaryFolder folder;
  const Image image = sample_image();
  write_exr(folder.path() / "a.exr", image);
  const Image read = read_exr(folder.path() / "a.exr");
  EXPECT_EQ(read.width, image.width);
  EXPECT_EQ(read.height, image.height);
  EXPECT_EQ(read.channels, image.channels);
  EXPECT_EQ(read.attributes, image.attributes);
}

TEST(Exr, SameImageSameBytes) {
  const TemporaryFolder folder;
  const auto bytes = [&](const char* name) {
    write_exr(folder.path() / name, sample_image());
    std::ifstream in(folder.path() / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_EQ(bytes("a.exr"), bytes("b.exr"));
}

// As other programs write them: several types, and a data window that does not start at (0, 0).
TEST(Exr, ReadsHalfAndIntegerChannelsOfAnyDataWindow) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "mixed.exr";
  const Imath::Box2i window({-2, 5}, {0, 6});  // 3 x 2
  std::array<half, 6> halves;
  std::array<unsigned, 6> integers{};
  for (unsigned i = 0; i < 6; ++i) {
    halves[i] = 0.5F * static_cast<float>(i);
    integers[i] = 10 * i;
  }
  {
    Imf::Header header(window, window);
    header.channels().insert("H", Imf::Channel(Imf::HALF));
    header.channels().insert("U", Imf::Channel(Imf::UINT));
    Imf::FrameBuffer buffer;
    const auto insert = [&](const char* name, Imf::PixelType type, void* data, ptrdiff_t size) {
      char* base = static_cast<char*>(data) - size * (window.min.x + 3 * window.min.y);
      buffer.insert(
          name, Imf::Slice(type, base, static_cast<size_t>(size), static_cast<size_t>(3 * size)));
    };
    insert("H", Imf::HALF, halves.data(), sizeof(half));
    insert("U", Imf::UINT, integers.data(), sizeof(unsigned));
    Imf::OutputFile file(path.c_str(), header);
    file.setFrameBuffer(buffer);
    file.writePixels(2);
  }
  const Image image = read_exr(path);
  EXPECT_EQ(image.width, 3);
  EXPECT_EQ(image.height, 2);
  EXPECT_EQ(image.channel("H"), (std::vector<float>{0, 0.5F, 1, 1.5F, 2, 2.5F}));
  EXPECT_EQ(image.channel("U"), (std::vector<float>{0, 10, 20, 30, 40, 50}));
}

TEST(Exr, NamesTheChannelsThatThereAre) {
  expect_error(ErrorKind::kInvalidInput, {"no channel R", "Y, mask.Y, sigma_t.Y"},
               [] { sample_image().channel("R"); });
}

// --- Bad input: a row each
// ------------------------------------------------------------------------

struct BadExr {
  const char* name;
  // Puts the file at the path.
  void (*make)(const TemporaryFolder& folder, const std::filesystem::path& path);
  ErrorKind kind;
  std::vector<std::string> message;
};

template <int kind>
void write_not_finite(const TemporaryFolder&, const std::filesystem::path& path) {
  Image image = sample_image();
  constexpr std::array kValues{std::numeric_limits<float>::quiet_NaN(),
                               -std::numeric_limits<float>::infinity()};
  image.channels["sigma_t.Y"][3 + 7 * 20] = kValues[kind];
  write_exr(path, image);
}

void write_cut(const std::filesystem::path& path, double fraction) {
  write_exr(path, sample_image());
  const auto size = static_cast<double>(std::filesystem::file_size(path));
  std::filesystem::resize_file(path, static_cast<uintmax_t>(size * fraction));
}

const std::vector<BadExr> kBadExrs{
    {"missing", [](auto&, auto&) {}, ErrorKind::kIo, {"cannot open the image", "bad.exr"}},
    {"folder",
     [](auto&, auto& path) { std::filesystem::create_directory(path); },
     ErrorKind::kIo,
     {"cannot open the image"}},
    {"empty",
     [](auto& folder, auto&) { folder.write("bad.exr", ""); },
     ErrorKind::kDataLoss,
     {"bad.exr is not a complete OpenEXR image"}},
    {"text",
     [](auto& folder, auto&) { folder.write("bad.exr", "not an image at all"); },
     ErrorKind::kDataLoss,
     {"bad.exr is not a complete OpenEXR image"}},
    {"cut_in_the_header",
     [](auto&, auto& path) { write_cut(path, 0.05); },
     ErrorKind::kDataLoss,
     {"bad.exr is not a complete OpenEXR image"}},
    {"cut_in_the_middle",
     [](auto&, auto& path) { write_cut(path, 0.6); },
     ErrorKind::kDataLoss,
     {"bad.exr is not a complete OpenEXR image"}},
    {"cut_near_the_end",
     [](auto&, auto& path) { write_cut(path, 0.99); },
     ErrorKind::kDataLoss,
     {"bad.exr is not a complete OpenEXR image"}},
    {"nan",
     write_not_finite<0>,
     ErrorKind::kInvalidInput,
     {"bad.exr", "channel sigma_t.Y is nan", "x = 3, y = 20"}},
    {"infinite",
     write_not_finite<1>,
     ErrorKind::kInvalidInput,
     {"bad.exr", "channel sigma_t.Y is -inf", "x = 3, y = 20"}},
    // The header alone, of an image that would take 4 TiB: refused before anything is allocated.
    {"promises_more_than_it_holds",
     [](auto&, auto& path) {
       Imf::Header header(1 << 20, 1 << 20);
       header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
       Imf::OutputFile(path.c_str(), header);
     },
     ErrorKind::kDataLoss,
     {"cut short"}},
};

class BadExrTest : public ::testing::TestWithParam<BadExr> {};

TEST_P(BadExrTest, IsRefused) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "bad.exr";
  GetParam().make(folder, path);
  expect_error(GetParam().kind, GetParam().message, [&] { read_exr(path); });
}

INSTANTIATE_TEST_SUITE_P(Table, BadExrTest, ::testing::ValuesIn(kBadExrs),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(Exr, SaysWhereItCannotWrite) {
  expect_error(ErrorKind::kIo, {"/nowhere/a.exr"},
               [] { write_exr("/nowhere/a.exr", sample_image()); });
}

// --- PNG
// ------------------------------------------------------------------------------------------

TEST(Png, ReadsBackWhatWasWritten) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.png";
  const std::vector<unsigned char> rgb{255, 0, 0, 0, 255, 0, 0, 0, 255, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  write_png(path, 3, 2, rgb);

  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_file(&png, path.c_str()));
  EXPECT_EQ(png.width, 3U);
  EXPECT_EQ(png.height, 2U);
  png.format = PNG_FORMAT_RGB;
  std::vector<unsigned char> read(PNG_IMAGE_SIZE(png));
  ASSERT_TRUE(png_image_finish_read(&png, nullptr, read.data(), 0, nullptr));
  EXPECT_EQ(read, rgb);
}

TEST(Png, SaysWhereItCannotWrite) {
  expect_error(ErrorKind::kIo, {"/nowhere/a.png"}, [] {
    write_png("/nowhere/a.png", 1, 1, std::vector<unsigned char>{0, 0, 0});
  });
}

}  // namespace
}  // namespace itn
