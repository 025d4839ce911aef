#include "client/scene/panorama_file.h"

#include <fmt/format.h>
#include <png.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "client/image/attributes.h"
#include "client/image/channels.h"
#include "client/image/image.h"
#include "client/image/image_format.h"
#include "client/image/srgb.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/scene/wire_array.h"

namespace itn {

namespace {

v1::Pixels pixels_of(const Image& image, const std::string& name) {
  const std::vector<std::string> channels = radiance_channels(image, name);
  const auto plane = [&](size_t colour) -> const std::vector<float>& {
    return image.channel(channels[channels.size() == 1 ? 0 : colour]);
  };
  const auto &r = plane(0), &g = plane(1), &b = plane(2);
  std::vector<float> rgb;
  rgb.reserve(3 * r.size());
  for (size_t i = 0; i < r.size(); ++i) rgb.insert(rgb.end(), {r[i], g[i], b[i]});
  v1::Pixels pixels;
  pixels.set_width(static_cast<uint32_t>(image.width));
  pixels.set_height(static_cast<uint32_t>(image.height));
  pixels.set_rgb(to_bytes(rgb));
  return pixels;
}

// Rows between those that it has, of which the first and the last stand at the ends.
void take_rows_between(Image& image) {
  const auto width = static_cast<size_t>(image.width);
  for (auto& [name, plane] : image.channels) {
    for (size_t i = 0; i + width < plane.size(); ++i) plane[i] = (plane[i] + plane[i + width]) / 2;
    plane.resize(plane.size() - width);
  }
  --image.height;
}

// By libpng's simplified interface.
v1::Pixels decode_png(const std::string& bytes, const std::string& name) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  const auto check = [&](int done) {
    if (done != 0) return;
    const std::string reason = png.message;
    png_image_free(&png);
    throw Error(ErrorKind::kDataLoss, fmt::format("{}: cannot read it: {}", name, reason));
  };
  check(png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()));
  constexpr uint32_t kMaxSide = 16384;
  if (png.width > kMaxSide || png.height > kMaxSide) {
    const std::string size = fmt::format("{} x {}", png.width, png.height);
    png_image_free(&png);
    throw invalid_input(
        fmt::format("{} has {} pixels; it must have at most {} a side", name, size, kMaxSide));
  }
  // 16 bits that do not say how they are encoded are sRGB, too. Colours are not multiplied by
  // alpha.
  png.flags |= PNG_IMAGE_FLAG_16BIT_sRGB;
  const bool is_wide = (png.format & PNG_FORMAT_FLAG_LINEAR) != 0;
  const bool has_alpha = (png.format & PNG_FORMAT_FLAG_ALPHA) != 0;
  if (has_alpha) {
    png_image_free(&png);
    throw invalid_input(
        fmt::format("{} has alpha, and a surface has no holes; save the image without it", name));
  }
  std::vector<float> rgb;
  if (is_wide) {  // libpng makes 16-bit linear light of it
    png.format = PNG_FORMAT_LINEAR_RGB;
    std::vector<uint16_t> linear(PNG_IMAGE_SIZE(png) / sizeof(uint16_t));
    check(png_image_finish_read(&png, nullptr, linear.data(), 0, nullptr));
    for (const uint16_t value : linear) rgb.push_back(static_cast<float>(value / 65535.0));
  } else {
    png.format = PNG_FORMAT_RGB;
    std::vector<unsigned char> encoded(PNG_IMAGE_SIZE(png));
    check(png_image_finish_read(&png, nullptr, encoded.data(), 0, nullptr));
    for (const unsigned char value : encoded) {
      rgb.push_back(static_cast<float>(linear_of_srgb(value / 255.0)));
    }
  }
  v1::Pixels pixels;
  pixels.set_width(png.width);
  pixels.set_height(png.height);
  pixels.set_rgb(to_bytes(rgb));
  return pixels;
}

}  // namespace

v1::Pixels load_panorama(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::string bytes = read_file(path, "image", kMaxImageFileBytes);
  const auto [format, kind] = recognize_format(bytes);
  if (format != ImageFormat::kExr && format != ImageFormat::kHdr && *kind != '\0') {
    throw invalid_input(fmt::format(
        "{} is {}; a panorama is linear radiance: OpenEXR or Radiance HDR", name, kind));
  }
  Image image = format == ImageFormat::kHdr ? decode_hdr(bytes, name) : decode_exr(bytes, name);
  if (image.attributes.contains(attribute::kChromaticities)) {
    throw invalid_input(fmt::format(
        "{} has other primaries than sRGB (its chromaticities); save it with those of sRGB", name));
  }
  if (image.attributes.contains(attribute::kRowsAtEnds)) {
    take_rows_between(image);
  } else if (image.width != 2 * image.height) {
    spdlog::warn(
        "{} is {} x {} pixels: it is taken for a panorama of all directions, by longitude and "
        "latitude, which is twice as wide as high. A light probe of a mirror ball, or a cube, is "
        "another thing",
        name, image.width, image.height);
  }
  // The part below 0 that resampling leaves beside a sun; more is no radiance, and is refused with
  // the scene.
  constexpr float kRinging = 0.01F;
  size_t below = 0;
  for (auto& [channel, plane] : image.channels) {
    const float least = -kRinging * *std::ranges::max_element(plane);
    for (float& value : plane) {
      if (!(value < 0 && value >= least)) continue;
      ++below;
      value = 0;
    }
  }
  if (below > 0) spdlog::warn("{}: {} values are below 0; they count as 0", name, below);
  return pixels_of(image, name);
}

v1::Pixels load_reflectances(const std::filesystem::path& path) {
  const std::string bytes = read_file(path, "image", kMaxImageFileBytes);
  const auto [format, kind] = recognize_format(bytes);
  if (format == ImageFormat::kPng) return decode_png(bytes, path.string());
  if (format != ImageFormat::kExr) {
    throw invalid_input(fmt::format("{} is {}; images of surfaces are PNG or OpenEXR",
                                    path.string(), *kind == '\0' ? "no image" : kind));
  }
  return pixels_of(decode_exr(bytes, path.string()), path.string());
}

}  // namespace itn
