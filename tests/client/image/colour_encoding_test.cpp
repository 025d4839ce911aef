// Colours of files, as Little CMS and the standards' own figures have them.
#include "client/image/colour_encoding.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <lcms2.h>
#include <libheif/heif.h>
#include <zlib.h>

#include <cmath>
#include <vector>

#include "client/image/photograph_file.h"
#include "client/image/srgb.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using testing::expect_error;

// A profile of these primaries; a curve of sRGB's, or of that gamma.
std::string profile_of(const Chromaticities& c, double gamma = 0) {
  cmsFloat64Number srgb[] = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};
  cmsToneCurve* const curve =
      gamma > 0 ? cmsBuildGamma(nullptr, gamma) : cmsBuildParametricToneCurve(nullptr, 4, srgb);
  cmsToneCurve* const curves[] = {curve, curve, curve};
  const cmsCIExyY white{c[6], c[7], 1};
  const cmsCIExyYTRIPLE primaries{{c[0], c[1], 1}, {c[2], c[3], 1}, {c[4], c[5], 1}};
  const cmsHPROFILE profile = cmsCreateRGBProfile(&white, &primaries, curves);
  cmsUInt32Number size = 0;
  cmsSaveProfileToMem(profile, nullptr, &size);
  std::string bytes(size, '\0');
  cmsSaveProfileToMem(profile, bytes.data(), &size);
  cmsCloseProfile(profile);
  cmsFreeToneCurve(curve);
  return bytes;
}
constexpr Chromaticities kP3{0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290};

// An image of one colour, 16 pixels a side, by OpenImageIO.
std::string file_of(const std::string& format, OIIO::TypeDesc type, std::vector<float> encoded,
                    const std::string& profile = "") {
  const testing::TemporaryFolder folder;
  const std::string path = folder.path("a." + format);
  OIIO::ImageSpec spec(16, 16, static_cast<int>(encoded.size()), type);
  spec.attribute("CompressionQuality", 100);
  spec.attribute("jpeg:subsampling", "4:4:4");
  if (!profile.empty()) {
    spec.attribute("ICCProfile",
                   OIIO::TypeDesc(OIIO::TypeDesc::UINT8, static_cast<int>(profile.size())),
                   profile.data());
  }
  std::vector<float> all;
  for (int i = 0; i < 256; ++i) all.insert(all.end(), encoded.begin(), encoded.end());
  const auto output = OIIO::ImageOutput::create(path);
  EXPECT_TRUE(output && output->open(path, spec) &&
              output->write_image(OIIO::TypeDesc::FLOAT, all.data()) && output->close());
  return read_file(path, "image");
}

void expect_colour(const PhotographFile& file, double r, double g, double b, double tolerance) {
  EXPECT_NEAR(file.image.channel("R")[40], r, tolerance);
  EXPECT_NEAR(file.image.channel("G")[40], g, tolerance);
  EXPECT_NEAR(file.image.channel("B")[40], b, tolerance);
}

std::vector<float> srgb_of(double r, double g, double b) {
  return {static_cast<float>(srgb_of_linear(r)), static_cast<float>(srgb_of_linear(g)),
          static_cast<float>(srgb_of_linear(b))};
}

// Light (.5, .25, .125) of Display P3 is this linear sRGB, by the matrix between them (CSS Color
// 4).
TEST(ColourEncoding, ProfilesAreHonoured) {
  const std::string p3 = profile_of(kP3);
  for (const auto& [format, type, tolerance] : {std::tuple{"jpg", OIIO::TypeDesc::UINT8, 0.015},
                                                {"png", OIIO::TypeDesc::UINT8, 0.005},
                                                {"tif", OIIO::TypeDesc::UINT16, 1e-3}}) {
    SCOPED_TRACE(format);
    const PhotographFile file =
        decode_photograph(file_of(format, type, srgb_of(0.5, 0.25, 0.125), p3), "photo");
    expect_colour(file, 0.55624, 0.23949, 0.10812, tolerance);
    EXPECT_TRUE(file.encoded);
    EXPECT_FALSE(file.may_be_linear);
  }
}

TEST(ColourEncoding, ProfilesOfSrgbChangeNothing) {
  const auto encoded = srgb_of(0.5, 0.25, 0.125);
  const std::string with =
      file_of("png", OIIO::TypeDesc::UINT8, encoded, profile_of(kSrgbChromaticities));
  const std::string without = file_of("png", OIIO::TypeDesc::UINT8, encoded);
  EXPECT_EQ(decode_photograph(with, "a").image.channels,
            decode_photograph(without, "b").image.channels);
}

// Floating-point numbers are decoded as integers are; what is said by hand, too.
TEST(ColourEncoding, FloatsMayBeEncoded) {
  const auto encoded = srgb_of(0.5, 0.25, 0.125);
  const std::string with =
      file_of("tif", OIIO::TypeDesc::FLOAT, encoded, profile_of(kSrgbChromaticities));
  expect_colour(decode_photograph(with, "a"), 0.5, 0.25, 0.125, 1e-3);
  const std::string without = file_of("tif", OIIO::TypeDesc::FLOAT, encoded);
  expect_colour(decode_photograph(without, "b", false), 0.5, 0.25, 0.125, 1e-5);
  EXPECT_NEAR(decode_photograph(without, "c").image.channel("R")[0], encoded[0], 1e-6);
}

TEST(ColourEncoding, LinearProfilesAreLinear) {
  const PhotographFile file = decode_photograph(
      file_of("tif", OIIO::TypeDesc::UINT16, {0.5F, 0.25F, 0.125F}, profile_of(kP3, 1)), "photo");
  expect_colour(file, 0.55624, 0.23949, 0.10812, 1e-3);
  EXPECT_FALSE(file.encoded);
}

TEST(ColourEncoding, WrongProfilesAreRefused) {
  const auto decode = [](const std::string& profile) {
    decode_photograph(file_of("tif", OIIO::TypeDesc::UINT8, {0.5F, 0.5F, 0.5F}, profile), "photo");
  };
  expect_error(ErrorKind::kInvalidInput, {"photo", "colour profile is damaged"},
               [&] { decode(std::string(200, 'x')); });
}

// 16-bit integers that do not say what they are, and a caller who does.
TEST(ColourEncoding, SixteenBitsMayBeLinear) {
  const std::string bytes = file_of("tif", OIIO::TypeDesc::UINT16, {0.5F, 0.25F, 0.125F});
  const PhotographFile file = decode_photograph(bytes, "photo");
  EXPECT_TRUE(file.may_be_linear);
  EXPECT_NEAR(file.image.channel("R")[0], linear_of_srgb(0.5), 1e-4);
  const PhotographFile linear = decode_photograph(bytes, "photo", true);
  EXPECT_FALSE(linear.may_be_linear || linear.encoded);
  expect_colour(linear, 0.5, 0.25, 0.125, 1e-4);
  EXPECT_TRUE(decode_photograph(bytes, "photo", false).encoded);
  EXPECT_FALSE(decode_photograph(file_of("tif", OIIO::TypeDesc::FLOAT, {0.5F}), "a").may_be_linear);
}

// Some values of the standards: ST 2084's 100 cd/m^2 is .508, BT.2100's half of HLG a twelfth.
TEST(ColourEncoding, CurvesAreThoseOfTheStandards) {
  const auto light = [](int transfer, double value) {
    return linear_of(encoding_of_code_points(1, transfer, "a"), value);
  };
  EXPECT_NEAR(light(16, 0.508078), 100.0 / 203, 1e-4);
  EXPECT_NEAR(light(16, 1), 10000.0 / 203, 1e-6);
  EXPECT_NEAR(light(18, 0.5), 1 / 12.0, 1e-9);
  EXPECT_NEAR(light(18, 1), 1, 1e-6);
  EXPECT_NEAR(light(1, 1.099 * std::pow(0.5, 0.45) - 0.099), 0.5, 1e-9);
  EXPECT_NEAR(light(4, 0.5), std::pow(0.5, 2.2), 1e-9);
  EXPECT_EQ(light(8, 0.25), 0.25);
  EXPECT_NEAR(light(13, 0.5), linear_of_srgb(0.5), 1e-9);
  expect_error(ErrorKind::kInvalidInput, {"photo", "transfer characteristics are number 17"},
               [] { encoding_of_code_points(1, 17, "photo"); });
  expect_error(ErrorKind::kInvalidInput, {"photo", "primaries are number 22"},
               [] { encoding_of_code_points(22, 13, "photo"); });
}

// A HEIC file of two halves, of 8 bits, whose code points are these, by libheif itself.
std::string heic_of(int left, int right, heif_color_primaries primaries,
                    heif_transfer_characteristics transfer) {
  constexpr int kSide = 64;
  heif_image* image = nullptr;
  heif_image_create(kSide, kSide, heif_colorspace_RGB, heif_chroma_interleaved_RGB, &image);
  heif_image_add_plane(image, heif_channel_interleaved, kSide, kSide, 8);
  int stride = 0;
  uint8_t* const plane = heif_image_get_plane(image, heif_channel_interleaved, &stride);
  for (int y = 0; y < kSide; ++y) {
    for (int i = 0; i < 3 * kSide; ++i) {
      plane[y * stride + i] = static_cast<uint8_t>(i < 3 * kSide / 2 ? left : right);
    }
  }
  heif_color_profile_nclx* const nclx = heif_nclx_color_profile_alloc();
  nclx->color_primaries = primaries;
  nclx->transfer_characteristics = transfer;
  nclx->matrix_coefficients = heif_matrix_coefficients_ITU_R_BT_709_5;
  nclx->full_range_flag = 1;
  heif_image_set_nclx_color_profile(image, nclx);
  heif_context* const context = heif_context_alloc();
  heif_encoder* encoder = nullptr;
  heif_context_get_encoder_for_format(context, heif_compression_HEVC, &encoder);
  heif_encoder_set_lossless(encoder, 1);
  heif_encoding_options* const options = heif_encoding_options_alloc();
  options->output_nclx_profile = nclx;
  options->macOS_compatibility_workaround_no_nclx_profile = 0;
  EXPECT_EQ(heif_context_encode_image(context, image, encoder, options, nullptr).code,
            heif_error_Ok);
  std::string bytes;
  heif_writer writer{1, [](heif_context*, const void* data, size_t size, void* to) {
                       static_cast<std::string*>(to)->assign(static_cast<const char*>(data), size);
                       return heif_error{heif_error_Ok, heif_suberror_Unspecified, ""};
                     }};
  heif_context_write(context, &writer, &bytes);
  heif_encoding_options_free(options);
  heif_encoder_release(encoder);
  heif_context_free(context);
  heif_nclx_color_profile_free(nclx);
  heif_image_release(image);
  return bytes;
}

TEST(ColourEncoding, CodePointsOfHeicCount) {
  const auto ratio = [](heif_transfer_characteristics transfer) {
    const std::string bytes = heic_of(150, 100, heif_color_primaries_ITU_R_BT_709_5, transfer);
    const Image image = decode_photograph(bytes, "photo").image;
    const std::vector<float>& plane = image.channel("R");
    return double{plane[40 * 64 + 10]} / double{plane[40 * 64 + 54]};
  };
  const ColourEncoding pq = encoding_of_code_points(1, 16, "a");
  EXPECT_NEAR(ratio(heif_transfer_characteristic_ITU_R_BT_2100_0_PQ),
              linear_of(pq, 150 / 255.0) / linear_of(pq, 100 / 255.0), 0.5);
  EXPECT_NEAR(ratio(heif_transfer_characteristic_IEC_61966_2_1),
              linear_of_srgb(150 / 255.0) / linear_of_srgb(100 / 255.0), 0.1);
  EXPECT_NEAR(ratio(heif_transfer_characteristic_linear), 1.5, 0.05);
}

// A PNG with a chunk put behind its header.
std::string with_chunk(std::string png, const std::string& type, const std::string& data) {
  const auto big = [](uint32_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift);
    return bytes;
  };
  const std::string content = type + data;
  const auto sum =
      crc32(0, reinterpret_cast<const Bytef*>(content.data()), static_cast<uInt>(content.size()));
  return png.insert(
      33, big(static_cast<uint32_t>(data.size())) + content + big(static_cast<uint32_t>(sum)));
}

TEST(ColourEncoding, CodePointsOfPngCount) {
  const std::string png = file_of("png", OIIO::TypeDesc::UINT16, {0.5F, 0.5F, 0.5F});
  const auto read = [&](int primaries, int transfer, char is_full = 1) {
    const std::string data{static_cast<char>(primaries), static_cast<char>(transfer), 0, is_full};
    return decode_photograph(with_chunk(png, "cICP", data), "photo").image.channel("R")[0];
  };
  EXPECT_NEAR(read(1, 8), 0.5, 1e-4);
  EXPECT_NEAR(read(9, 16), 92.2 / 203, 0.01);
  EXPECT_NEAR(read(12, 13), linear_of_srgb(0.5), 1e-3);
  expect_error(ErrorKind::kInvalidInput, {"photo", "narrow range"}, [&] { read(1, 8, 0); });
}

}  // namespace
}  // namespace itn
