// The values of a photograph's file, as they are in it.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "client/image/colour_encoding.h"
#include "client/image/photograph_header.h"
#include "common/error.h"

namespace itn {

struct EncodedPixels {
  int width = 0;
  int height = 0;
  int channels = 0;  // 1: gray, 2: gray and alpha, 3: RGB, 4: RGB and alpha
  // Channels interleaved, top row first.
  std::variant<std::vector<uint8_t>, std::vector<uint16_t>, std::vector<float>> values;
  ColourEncoding encoding;  // simplified()
  bool multiplied_by_alpha = false;
  Exif exif;  // its orientation is still to be applied

  bool has_alpha() const { return channels == 2 || channels == 4; }
};

// `header` is that of the bytes. Throws Error: kDataLoss (damaged, cut short), kInvalidInput (a
// kind of image that is not read). `name` is for messages.
EncodedPixels decode_pixels(std::string_view bytes, const PhotographHeader& header,
                            const std::string& name);

// PNG and HEIF are decoded by libpng and libheif themselves. OpenImageIO lets libpng print what it
// finds wrong, and reads beyond the end of what libheif has decoded of a damaged file.
EncodedPixels decode_png_pixels(std::string_view bytes, const PhotographHeader& header,
                                const std::string& name);
EncodedPixels decode_heif_pixels(std::string_view bytes, const PhotographHeader& header,
                                 const std::string& name);

// The error of a file that is not what its header says.
Error damaged(const std::string& name, const PhotographHeader& header, const std::string& reason);

}  // namespace itn
