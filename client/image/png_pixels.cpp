#include <fmt/format.h>
#include <png.h>

#include <csetjmp>
#include <cstring>
#include <new>

#include "client/image/encoded_pixels.h"

namespace itn {
namespace {

// libpng leaves a function by longjmp(), which destroys nothing: what it works with is here, and
// the functions that it leaves have no objects of their own.
struct PngReader {
  explicit PngReader(std::string_view file) : rest(file) {
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, on_error, on_warning);
    info = png == nullptr ? nullptr : png_create_info_struct(png);
    if (info == nullptr) throw std::bad_alloc();
    png_set_read_fn(png, this, read);
  }
  ~PngReader() { png_destroy_read_struct(&png, &info, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  // False: see `message`.
  bool read_info() {
    if (setjmp(jump) != 0) return false;
    png_read_info(png, info);
    png_set_expand(png);  // palettes, fewer than 8 bits, a transparent colour
    png_set_swap(png);    // 16 bits come with the lower byte last
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    return true;
  }
  bool read_rows(png_bytep* rows) {
    if (setjmp(jump) != 0) return false;
    png_read_image(png, rows);
    png_read_end(png, nullptr);
    return true;
  }

  static void on_error(png_structp png, png_const_charp text) {
    auto* reader = static_cast<PngReader*>(png_get_error_ptr(png));
    std::strncpy(reader->message, text, sizeof reader->message - 1);
    std::longjmp(reader->jump, 1);
  }
  static void on_warning(png_structp, png_const_charp) {}
  static void read(png_structp png, png_bytep to, size_t size) {
    auto* reader = static_cast<PngReader*>(png_get_io_ptr(png));
    if (size > reader->rest.size()) png_error(png, "it was cut short");
    std::memcpy(to, reader->rest.data(), size);
    reader->rest.remove_prefix(size);
  }

  png_structp png = nullptr;
  png_infop info = nullptr;
  std::jmp_buf jump{};
  char message[128] = {};
  std::string_view rest;
};

// By the most that the file says: code points, a profile, sRGB, or gamma and primaries.
ColourEncoding encoding_of(const PngReader& reader, const PhotographHeader& header,
                           const std::string& name) {
  if (header.code_points) {
    return encoding_of_code_points(header.code_points->first, header.code_points->second, name);
  }
  ColourEncoding encoding;
  encoding.is_stated = png_get_bit_depth(reader.png, reader.info) != 16;
  png_charp profile_name = nullptr;
  png_bytep profile = nullptr;
  png_uint_32 length = 0;
  int compression = 0, intent = 0;
  if (png_get_iCCP(reader.png, reader.info, &profile_name, &compression, &profile, &length) != 0) {
    encoding.profile.assign(reinterpret_cast<const char*>(profile), length);
    return encoding;
  }
  if (png_get_sRGB(reader.png, reader.info, &intent) != 0) {
    encoding.is_stated = true;
    return encoding;
  }
  double exponent = 0;  // of the curve from light to values: 1 / 2.2 is next to sRGB's
  if (png_get_gAMA(reader.png, reader.info, &exponent) != 0) {
    encoding.is_stated = true;
    if (exponent > 0.95 && exponent < 1.05) {
      encoding.curve = ColourEncoding::Curve::kLinear;
    } else if (!(exponent > 0.44 && exponent < 0.47)) {
      encoding.curve = ColourEncoding::Curve::kPower;
      encoding.exponent = 1 / exponent;
      if (!(exponent > 0.2 && exponent < 5)) {
        throw invalid_input(
            fmt::format("{} says that it is encoded by a gamma of {:.2f}; from 0.2 to 5 are read",
                        name, 1 / exponent));
      }
    }
  }
  Chromaticities c{};
  if (png_get_cHRM(reader.png, reader.info, &c[6], &c[7], &c[0], &c[1], &c[2], &c[3], &c[4],
                   &c[5]) != 0 &&
      !are_same(c, kSrgbChromaticities)) {
    encoding.primaries = c;
  }
  return encoding;
}

template <typename T>
std::vector<T> read_values(PngReader& reader, size_t row_values, size_t height,
                           const PhotographHeader& header, const std::string& name) {
  std::vector<T> values(row_values * height);
  std::vector<png_bytep> rows(height);
  for (size_t y = 0; y < height; ++y) {
    rows[y] = reinterpret_cast<png_bytep>(values.data() + y * row_values);
  }
  if (reader.read_rows(rows.data())) return values;
  throw damaged(name, header, reader.message);
}

}  // namespace

EncodedPixels decode_png_pixels(std::string_view bytes, const PhotographHeader& header,
                                const std::string& name) {
  PngReader reader(bytes);
  if (!reader.read_info()) throw damaged(name, header, reader.message);
  EncodedPixels pixels{.width = static_cast<int>(png_get_image_width(reader.png, reader.info)),
                       .height = static_cast<int>(png_get_image_height(reader.png, reader.info)),
                       .channels = png_get_channels(reader.png, reader.info),
                       .values = {},
                       .encoding = encoding_of(reader, header, name),
                       .exif = header.exif};
  const auto row_values = static_cast<size_t>(pixels.width) * static_cast<size_t>(pixels.channels);
  const auto height = static_cast<size_t>(pixels.height);
  if (png_get_bit_depth(reader.png, reader.info) == 16) {
    pixels.values = read_values<uint16_t>(reader, row_values, height, header, name);
  } else {
    pixels.values = read_values<uint8_t>(reader, row_values, height, header, name);
  }
  return pixels;
}

}  // namespace itn
