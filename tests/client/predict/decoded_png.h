// PNG files for tests to look at.
#pragma once

#include <png.h>

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "client/panels.h"

namespace itn::testing {

struct DecodedPng {
  int width = 0, height = 0;
  std::vector<Rgb> pixels;

  Rgb at(int x, int y) const {
    return pixels.at(static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x));
  }
};

// Throws std::runtime_error if the bytes are no whole PNG file.
inline DecodedPng decoded_png(std::string_view bytes) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_memory(&png, bytes.data(), bytes.size())) {
    throw std::runtime_error(png.message);
  }
  png.format = PNG_FORMAT_RGB;
  DecodedPng result{static_cast<int>(png.width), static_cast<int>(png.height), {}};
  result.pixels.resize(size_t{png.width} * png.height);
  if (!png_image_finish_read(&png, nullptr, result.pixels.data(), 0, nullptr)) {
    throw std::runtime_error(png.message);
  }
  return result;
}

}  // namespace itn::testing
