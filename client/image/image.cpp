#include "client/image/image.h"

#include <fmt/format.h>
#include <png.h>

#include <cmath>

#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {

const std::vector<float>& Image::channel(const std::string& name) const {
  const auto it = channels.find(name);
  if (it != channels.end()) return it->second;
  throw invalid_input(
      fmt::format("the image has no channel {}; it has: {}", name, channel_names()));
}

std::string Image::channel_names() const {
  std::string names;
  for (const auto& [name, plane] : channels) names += (names.empty() ? "" : ", ") + name;
  return names;
}

void check_finite(const Image& image, const std::string& name) {
  for (const auto& [channel, plane] : image.channels) {
    for (size_t i = 0; i < plane.size(); ++i) {
      if (std::isfinite(plane[i])) continue;
      const auto width = static_cast<size_t>(image.width);
      throw invalid_input(
          fmt::format("{}: channel {} is {} at pixel x = {}, y = {} (counted from the top left); "
                      "every value must be finite",
                      name, channel, plane[i], i % width, i / width));
    }
  }
}

std::string encode_png(int width, int height, std::span<const unsigned char> rgb) {
  const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
  const bool has_alpha = pixels > 0 && pixels == rgb.size() / 4;
  if (width < 1 || height < 1 || rgb.size() != (has_alpha ? 4 : 3) * pixels) {
    throw Error(ErrorKind::kInternal, fmt::format("{} bytes are not {} x {} pixels of 3 or 4 bytes",
                                                  rgb.size(), width, height));
  }
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(width);
  png.height = static_cast<png_uint_32>(height);
  png.format = has_alpha ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB;
  std::string bytes(PNG_IMAGE_PNG_SIZE_MAX(png), '\0');
  png_alloc_size_t size = bytes.size();
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, rgb.data(), 0, nullptr)) {
    throw Error(ErrorKind::kInternal, fmt::format("cannot encode a PNG: {}", png.message));
  }
  bytes.resize(size);
  return bytes;
}

void write_png(const std::filesystem::path& path, int width, int height,
               std::span<const unsigned char> rgb) {
  write_file_atomically(path, encode_png(width, height, rgb));
}

}  // namespace itn
