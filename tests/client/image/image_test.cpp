#include "client/image/image.h"

#include <ImfChannelList.h>
#include <ImfDoubleAttribute.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfIntAttribute.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>
#include <ImfTiledOutputFile.h>
#include <gmock/gmock.h>
#include <half.h>
#include <png.h>

#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <numeric>

#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace std::string_literals;
using namespace testing;

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
  image.attributes = {{"note", "of a test"}, {"empty", ""}, {"count", -3}, {"exact", 0.1}};
  return image;
}

// A tiled image of values 0, 1, 2, ...
void write_tiled(const std::filesystem::path& path, int side, unsigned tile) {
  std::vector<float> plane(static_cast<size_t>(side) * static_cast<size_t>(side));
  std::iota(plane.begin(), plane.end(), 0.0F);
  Imf::Header header(side, side);
  header.setTileDescription({tile, tile, Imf::ONE_LEVEL});
  header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
  Imf::FrameBuffer buffer;
  buffer.insert("Y", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(plane.data()), sizeof(float),
                                sizeof(float) * static_cast<size_t>(side)));
  Imf::TiledOutputFile file(path.c_str(), header);
  file.setFrameBuffer(buffer);
  file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
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

// Files as other programs write them: several types, and a data window that does not start at (0,
// 0).
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

TEST(Exr, ReadsTiles) {
  const TemporaryFolder folder;
  write_tiled(folder.path() / "tiled.exr", 50, 16);
  const Image image = read_exr(folder.path() / "tiled.exr");
  std::vector<float> expected(50 * 50);
  std::iota(expected.begin(), expected.end(), 0.0F);
  EXPECT_EQ(image.channel("Y"), expected);
}

// Compressed as far as it goes: nothing that is really there is refused.
TEST(Exr, ReadsLargeConstantImages) {
  const TemporaryFolder folder;
  const Image image{.width = 8192,
                    .height = 4096,
                    .channels = {{"Y", std::vector<float>(8192 * 4096, 1)}},
                    .attributes = {}};
  write_exr(folder.path() / "constant.exr", image);
  EXPECT_EQ(read_exr(folder.path() / "constant.exr").channels, image.channels);
}

TEST(Exr, NumbersOfTheHeaderAreNumbers) {
  const TemporaryFolder folder;
  write_exr(folder.path() / "a.exr", sample_image());
  const Imf::InputFile file((folder.path() / "a.exr").c_str());
  EXPECT_EQ(file.header().typedAttribute<Imf::IntAttribute>("count").value(), -3);
  EXPECT_EQ(file.header().typedAttribute<Imf::DoubleAttribute>("exact").value(), 0.1);
  EXPECT_EQ(file.header().typedAttribute<Imf::StringAttribute>("note").value(), "of a test");
}

TEST(Exr, ReadsFloatAttributesOfOthers) {
  const TemporaryFolder folder;
  {
    Imf::Header header(1, 1);
    header.insert("exposure", Imf::FloatAttribute(0.5F));
    header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
    float value = 1;
    Imf::FrameBuffer buffer;
    buffer.insert("Y", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(&value), 4, 4));
    Imf::OutputFile file((folder.path() / "a.exr").c_str(), header);
    file.setFrameBuffer(buffer);
    file.writePixels(1);
  }
  EXPECT_EQ(read_exr(folder.path() / "a.exr").attributes.at("exposure"), Attribute(0.5));
}

TEST(Exr, NamesTheChannelsThatThereAre) {
  expect_error(ErrorKind::kInvalidInput, {"no channel R", "Y, mask.Y, sigma_t.Y"},
               [] { sample_image().channel("R"); });
}

// --- Bad input: a row each ---

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

void write_header(const std::filesystem::path& path, int width, int height) {
  Imf::Header header(width, height);
  header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
  Imf::OutputFile(path.c_str(), header);
}

// Puts `replacement` behind the first occurrence of `key`.
void write_patched(const std::filesystem::path& path, const std::string& key,
                   const std::string& replacement) {
  write_exr(path, sample_image());
  std::string bytes = read_file(path, "image");
  const size_t at = bytes.find(key);
  ASSERT_NE(at, std::string::npos);
  write_file_atomically(path, bytes.replace(at + key.size(), replacement.size(), replacement));
}

const std::vector<BadExr> kBadExrs{
    {"missing",
     [](auto&, auto&) {},
     ErrorKind::kIo,
     {"cannot read the image", "bad.exr", "No such file"}},
    {"folder",
     [](auto&, auto& path) { std::filesystem::create_directory(path); },
     ErrorKind::kIo,
     {"it is a folder"}},
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
    // Headers alone: refused before anything is allocated.
    {"of_terabytes",
     [](auto&, auto& path) { write_header(path, 1 << 20, 1 << 20); },
     ErrorKind::kInvalidInput,
     {"1048576 x 1048576 pixels", "2^28"}},
    {"of_gigabytes",
     [](auto&, auto& path) { write_header(path, 1 << 14, 1 << 14); },
     ErrorKind::kDataLoss,
     {"its header claims 16384 x 16384 pixels of 1 channels"}},
    {"of_long_lines",
     [](auto&, auto& path) { write_header(path, 1 << 27, 1); },
     ErrorKind::kInvalidInput,
     {"lines of 536870912 bytes"}},
    {"entry_of_gigabytes",
     [](auto&, auto& path) { write_patched(path, "note\0string\0"s, "\xff\xff\xff\x7f"); },
     ErrorKind::kDataLoss,
     {"its header claims an entry of 2147483647 bytes"}},
    {"header_without_end",
     [](auto& folder, auto&) { folder.write("bad.exr", "\x76\x2f\x31\x01\x02\0\0\0name"s); },
     ErrorKind::kDataLoss,
     {"its header has no end"}},
    {"of_huge_tiles",
     [](auto&, auto& path) { write_tiled(path, 1, 4096); },
     ErrorKind::kInvalidInput,
     {"tiles of 4096 x 4096"}},
    {"of_several_parts",
     [](auto&, auto& path) {
       std::vector<Imf::Header> parts(2, Imf::Header(4, 4));
       for (Imf::Header& part : parts) {
         part.setName(&part == &parts.front() ? "a" : "b");
         part.setType(Imf::SCANLINEIMAGE);
         part.channels().insert("Y", Imf::Channel(Imf::FLOAT));
       }
       Imf::MultiPartOutputFile(path.c_str(), parts.data(), 2);
     },
     ErrorKind::kDataLoss,
     {"is not a complete OpenEXR image"}},
    {"subsampled",
     [](auto&, auto& path) {
       Imf::Header header(4, 4);
       header.channels().insert("RY", Imf::Channel(Imf::HALF, 2, 2));
       Imf::OutputFile(path.c_str(), header);
     },
     ErrorKind::kInvalidInput,
     {"channel RY", "subsampled"}},
};

// The first part has its own names, others that of their part before them.
TEST(Exr, ReadsSeveralParts) {
  const TemporaryFolder folder;
  const auto path = folder.path("parts.exr");
  std::vector<Imf::Header> headers(3, Imf::Header(2, 1));
  const std::vector<std::string> names{"picture", "second", "small"};
  headers[2].dataWindow().max.x = 0;
  for (size_t p = 0; p < 3; ++p) {
    headers[p].setName(names[p]);
    headers[p].setType(Imf::SCANLINEIMAGE);
    headers[p].channels().insert("Y", Imf::Channel(Imf::FLOAT));
  }
  {
    Imf::MultiPartOutputFile file(path.c_str(), headers.data(), 3);
    for (int p = 0; p < 3; ++p) {
      std::vector<float> values{static_cast<float>(p) + 0.25F, static_cast<float>(p) + 0.5F};
      Imf::FrameBuffer buffer;
      buffer.insert("Y", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(values.data()), 4, 8));
      Imf::OutputPart part(file, p);
      part.setFrameBuffer(buffer);
      part.writePixels(1);
    }
  }
  const Image image = read_exr(path);
  EXPECT_EQ(image.channel("small.Y"), (std::vector<float>{2.25F, 0}));
  EXPECT_EQ(image.channel("Y"), (std::vector<float>{0.25F, 0.5F}));
  EXPECT_EQ(image.channel("second.Y"), (std::vector<float>{1.25F, 1.5F}));
}

// What is shown is the display window, black where there are no pixels.
TEST(Exr, ShowsTheDisplayWindow) {
  const TemporaryFolder folder;
  const auto path = folder.path("window.exr");
  Imf::Header header(3, 2);
  header.dataWindow() = Imath::Box2i({1, 1}, {3, 2});  // beyond it on two sides
  header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
  std::vector<float> values{1, 2, 3, 4, 5, 6};
  {
    Imf::OutputFile file(path.c_str(), header);
    Imf::FrameBuffer buffer;
    char* const base = reinterpret_cast<char*>(values.data()) - 4 - 12;
    buffer.insert("Y", Imf::Slice(Imf::FLOAT, base, 4, 12));
    file.setFrameBuffer(buffer);
    file.writePixels(2);
  }
  const Image image = read_exr(path);
  EXPECT_EQ(image.width, 3);
  EXPECT_EQ(image.channel("Y"), (std::vector<float>{0, 0, 0, 0, 1, 2}));
}

TEST(Exr, HasSquarePixels) {
  const TemporaryFolder folder;
  const auto path = folder.path("wide.exr");
  Imf::Header header(2, 1);
  header.pixelAspectRatio() = 2;
  header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
  std::vector<float> values{1, 2};
  {
    Imf::OutputFile file(path.c_str(), header);
    Imf::FrameBuffer buffer;
    buffer.insert("Y", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(values.data()), 4, 8));
    file.setFrameBuffer(buffer);
    file.writePixels(1);
  }
  expect_error(ErrorKind::kInvalidInput, {"wide.exr", "2 times as wide as high"},
               [&] { read_exr(path); });
}

class BadExrTest : public ::testing::TestWithParam<BadExr> {};

TEST_P(BadExrTest, IsRefused) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "bad.exr";
  GetParam().make(folder, path);
  expect_error(GetParam().kind, GetParam().message, [&] { read_exr(path); });
}

INSTANTIATE_TEST_SUITE_P(Table, BadExrTest, ::testing::ValuesIn(kBadExrs),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(Exr, CutAnywhereIsAnError) {
  const TemporaryFolder folder;
  write_exr(folder.path("whole.exr"), sample_image());
  const std::string whole = read_file(folder.path("whole.exr"), "image");
  for (size_t at = 0; at < whole.size(); ++at) {
    expect_error(ErrorKind::kDataLoss, {"cut.exr"},
                 [&] { decode_exr(whole.substr(0, at), "cut.exr"); });
    if (::testing::Test::HasFailure()) break;
  }
}

TEST(Exr, SaysWhereItCannotWrite) {
  expect_error(ErrorKind::kIo, {"/nowhere/a.exr"},
               [] { write_exr("/nowhere/a.exr", sample_image()); });
}

// --- PNG ---

TEST(Png, ReadsBackWhatWasWritten) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.png";
  const std::vector<unsigned char> rgb{255, 0, 0, 0, 255, 0, 0, 0, 255, 1, 2, 3, 4, 5, 6, 7, 8, 9},
      rgba{255, 0, 0, 0, 0, 255, 0, 100, 9, 9, 9, 255};
  for (const auto& [pixels, width, height, format] :
       {std::tuple{rgb, 3, 2, uint32_t{PNG_FORMAT_RGB}}, {rgba, 3, 1, PNG_FORMAT_RGBA}}) {
    write_png(path, width, height, pixels);
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    ASSERT_TRUE(png_image_begin_read_from_file(&png, path.c_str()));
    EXPECT_EQ(static_cast<int>(png.width), width);
    EXPECT_EQ(static_cast<int>(png.height), height);
    EXPECT_EQ(png.format, format);
    std::vector<unsigned char> read(PNG_IMAGE_SIZE(png));
    ASSERT_TRUE(png_image_finish_read(&png, nullptr, read.data(), 0, nullptr));
    EXPECT_EQ(read, pixels);
  }
}

TEST(Png, SaysWhereItCannotWrite) {
  expect_error(ErrorKind::kIo, {"/nowhere/a.png"}, [] {
    write_png("/nowhere/a.png", 1, 1, std::vector<unsigned char>{0, 0, 0});
  });
}

}  // namespace
}  // namespace itn
