#include <fmt/format.h>
#include <png.h>

#include <csetjmp>
#include <cstring>
#include <new>

#include "common/image/encoded_pixels.h"

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

// Whether the values are linear. Curves that are neither sRGB's nor straight are refused.
bool says_linear(const PngReader& reader, const std::string& name) {
  int intent = 0;
  double exponent = 0;  // of the curve: 1 / 2.2 is next to sRGB, and written for it
  if (png_get_sRGB(reader.png, reader.info, &intent) != 0) return false;
  if (png_get_gAMA(reader.png, reader.info, &exponent) == 0) return false;
  if (exponent > 0.95 && exponent < 1.05) return true;
  if (exponent > 0.4 && exponent < 0.5) return false;
  throw invalid_input(
      fmt::format("{} says that it is encoded by a gamma of {:.2f}; only sRGB and "
                  "linear values are read. Save it as sRGB",
                  name, 1 / exponent));
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
                       .linear = says_linear(reader, name),
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
