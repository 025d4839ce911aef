// What the header of a photograph's file claims, read and checked before anything that decodes it
// allocates memory for it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "client/image/image_format.h"
#include "client/image/tiff_directory.h"

namespace itn {

inline constexpr int64_t kMaxPhotographSide = 16384;  // in pixels

struct PhotographHeader {
  ImageFormat format = ImageFormat::kUnknown;
  const char* format_name = "";  // for messages, with its article
  int64_t width = 0;
  int64_t height = 0;
  int64_t bytes_per_pixel = 0;  // decoded
  Exif exif{};
  std::string profile{};  // an ICC profile, of formats whose decoder does not tell it
  // Code points of a PNG (chunk cICP): primaries and transfer characteristics.
  std::optional<std::pair<int, int>> code_points{};
  int pages = 1;  // of a TIFF file, of which the first is read
};

// Reads the header of a PNG, JPEG, TIFF (its first image), WebP or HEIF file. Throws Error:
// kDataLoss (damaged, cut short, claims more than it can hold), kInvalidInput (another kind of
// file, or a kind of image of these formats that is not read; a side above 16384 pixels). `name` is
// for messages.
PhotographHeader read_photograph_header(std::string_view bytes, const std::string& name);

}  // namespace itn
