#include "common/image/photograph_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <variant>

#include "common/error.h"
#include "common/files/read_file.h"
#include "common/image/attributes.h"
#include "common/image/channels.h"
#include "common/image/encoded_pixels.h"
#include "common/image/srgb.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// As of an OpenEXR file.
constexpr uint64_t kMaxFileBytes = (uint64_t{1} << 32) + (uint64_t{1} << 24);

template <typename T>
constexpr double kTop = std::is_integral_v<T> ? double{std::numeric_limits<T>::max()} : 1;

// From where on a value is at the top of what the file can hold. Where JPEG has lost something, a
// white area is not 255 throughout. Cameras of 12 bits or more write their values times 16 or less
// into 16 bits: their white may be 4095 * 16.
template <typename T>
constexpr T kClippedFrom;
template <>
constexpr uint8_t kClippedFrom<uint8_t> = 254;
template <>
constexpr uint16_t kClippedFrom<uint16_t> = 4095 * 16;

// Where the pixels of an upright image are in the one that the file holds.
class Upright {
 public:
  // TIFF 6.0, tag 274: which side of the scene the file's first row and first column are.
  Upright(int orientation, int width, int height)
      : orientation_(orientation), width_(width), height_(height) {}

  int width() const { return swaps() ? height_ : width_; }
  int height() const { return swaps() ? width_ : height_; }

  size_t source(int x, int y) const {
    const int u = swaps() ? y : x, v = swaps() ? x : y;
    // 2: from the right; 3: from the right, bottom first; 4: bottom first; 5 to 8: columns for
    // rows.
    const bool from_right =
        orientation_ == 2 || orientation_ == 3 || orientation_ == 7 || orientation_ == 8;
    const bool from_bottom =
        orientation_ == 3 || orientation_ == 4 || orientation_ == 6 || orientation_ == 7;
    const int column = from_right ? width_ - 1 - u : u;
    const int row = from_bottom ? height_ - 1 - v : v;
    return static_cast<size_t>(row) * static_cast<size_t>(width_) + static_cast<size_t>(column);
  }

  // Calls f(pixel, source pixel) for every pixel.
  template <typename F>
  void for_each(const F& f) const {
    size_t pixel = 0;
    for (int y = 0; y < height(); ++y) {
      for (int x = 0; x < width(); ++x) f(pixel++, source(x, y));
    }
  }

 private:
  bool swaps() const { return orientation_ >= 5; }

  int orientation_;
  int width_;
  int height_;
};

Upright upright(const EncodedPixels& pixels) {
  return {pixels.exif.orientation, pixels.width, pixels.height};
}

// Linear light of every value that T can have; of floating-point numbers nothing.
template <typename T>
std::vector<float> curve(bool linear) {
  if constexpr (std::is_floating_point_v<T>) {
    return {};
  } else {
    std::vector<float> light(size_t{std::numeric_limits<T>::max()} + 1);
    for (size_t i = 0; i < light.size(); ++i) {
      const double encoded = static_cast<double>(i) / kTop<T>;
      light[i] = static_cast<float>(linear ? encoded : linear_of_srgb(encoded));
    }
    return light;
  }
}

// Linear light of a value. Files that have multiplied it by alpha did so before the curve.
template <typename T>
float light_of(T value, T alpha, bool divide, const std::vector<float>& curve) {
  if constexpr (std::is_floating_point_v<T>) {
    return divide && alpha > 0 ? static_cast<float>(value / alpha) : static_cast<float>(value);
  } else {
    if (!divide || alpha == 0) return curve[value];
    const double divided = std::min(kTop<T>, std::round(kTop<T> * value / alpha));
    return curve[static_cast<size_t>(divided)];
  }
}

template <typename T>
Image to_linear(const EncodedPixels& pixels, const std::vector<T>& values) {
  const Upright to = upright(pixels);
  Image image{.width = to.width(), .height = to.height(), .channels = {}, .attributes = {}};
  const std::vector<float> table = curve<T>(pixels.linear);
  const auto channels = static_cast<size_t>(pixels.channels);
  const size_t colours = channels - (pixels.has_alpha() ? 1 : 0);
  const size_t count = values.size() / channels;
  static constexpr std::array kColourNames{"R", "G", "B"};
  for (size_t channel = 0; channel < colours; ++channel) {
    std::vector<float>& plane = image.channels[colours == 1 ? "Y" : kColourNames[channel]];
    plane.resize(count);
    to.for_each([&](size_t pixel, size_t source) {
      const T* value = &values[source * channels];
      plane[pixel] =
          light_of(value[channel], value[channels - 1], pixels.multiplied_by_alpha, table);
    });
  }
  if (pixels.has_alpha()) {
    std::vector<float>& plane = image.channels["A"];
    plane.resize(count);
    to.for_each([&](size_t pixel, size_t source) {
      plane[pixel] = static_cast<float>(values[source * channels + colours] / kTop<T>);
    });
  }
  return image;
}

template <typename T>
std::vector<unsigned char> clipped_pixels(const EncodedPixels& pixels,
                                          const std::vector<T>& values) {
  if constexpr (std::is_floating_point_v<T>) {
    return {};
  } else {
    const auto channels = static_cast<size_t>(pixels.channels);
    const size_t colours = channels - (pixels.has_alpha() ? 1 : 0);
    std::vector<unsigned char> clipped(values.size() / channels);
    upright(pixels).for_each([&](size_t pixel, size_t source) {
      const std::span colour(&values[source * channels], colours);
      clipped[pixel] = std::ranges::any_of(colour, [](T v) { return v >= kClippedFrom<T>; });
    });
    return clipped;
  }
}

EncodedPixels pixels_of(std::string_view bytes, const std::string& name) {
  return decode_pixels(bytes, read_photograph_header(bytes, name), name);
}

bool is_exr(std::string_view bytes) {
  return recognize_format(bytes).format == ImageFormat::kExr;
}

// What itn merge wrote of the photographs that it merged.
void restore_unmerged_attributes(PhotographFile& file) {
  if (file.image.has("clipped.Y")) {
    const std::vector<float>& clipped = file.image.channel("clipped.Y");
    file.clipped.assign(clipped.begin(), clipped.end());
  }
  const auto response = file.image.attributes.find(attribute::kResponse);
  file.encoded = response != file.image.attributes.end() && response->second == Attribute("srgb");
}

// --- Masks ---

template <typename T>
bool alpha_varies(const std::vector<T>& values, size_t channels) {
  for (size_t at = channels - 1; at < values.size(); at += channels) {
    if (values[at] != values[channels - 1]) return true;
  }
  return false;
}

template <typename T>
MaskFile mask_of(const EncodedPixels& pixels, const std::vector<T>& values,
                 const std::string& name) {
  const Upright to = upright(pixels);
  const auto channels = static_cast<size_t>(pixels.channels);
  const bool by_alpha = pixels.has_alpha() && alpha_varies(values, channels);
  MaskFile mask{.width = to.width(),
                .height = to.height(),
                .values = std::vector<float>(values.size() / channels)};
  to.for_each([&](size_t pixel, size_t source) {
    const T* value = &values[source * channels];
    if (!by_alpha && channels >= 3 && !(value[0] == value[1] && value[1] == value[2])) {
      const auto width = static_cast<size_t>(mask.width);
      throw invalid_input(fmt::format(
          "{} has colours, at pixel x = {}, y = {} (counted from the top left) for one; a mask is "
          "gray, white on the object, or has it in its alpha",
          name, pixel % width, pixel / width));
    }
    mask.values[pixel] = static_cast<float>((by_alpha ? value[channels - 1] : value[0]) / kTop<T>);
  });
  return mask;
}

}  // namespace

PhotographFile decode_photograph(std::string_view bytes, const std::string& name) {
  if (is_exr(bytes)) {
    PhotographFile file;
    file.image = decode_exr(bytes, name);
    restore_unmerged_attributes(file);
    return file;
  }
  const EncodedPixels pixels = pixels_of(bytes, name);
  PhotographFile file = std::visit(
      [&]<typename T>(const std::vector<T>& values) {
        return PhotographFile{.image = to_linear(pixels, values),
                              .clipped = clipped_pixels(pixels, values),
                              .encoded = !pixels.linear,
                              .exposure_seconds = pixels.exif.exposure_seconds,
                              .f_number = pixels.exif.f_number,
                              .iso = pixels.exif.iso};
      },
      pixels.values);
  check_finite(file.image, name);
  return file;
}

PhotographFile read_photograph(const fs::path& path) {
  return decode_photograph(read_file_or_stdin(path, "photograph", kMaxFileBytes), path.string());
}

MaskFile decode_mask(std::string_view bytes, const std::string& name) {
  const std::string mask_name = "the mask " + name;
  if (is_exr(bytes)) {
    Image image = decode_exr(bytes, mask_name);
    return {image.width, image.height, std::move(image.channels[mask_channel(image, mask_name)])};
  }
  const EncodedPixels pixels = pixels_of(bytes, mask_name);
  return std::visit([&](const auto& values) { return mask_of(pixels, values, mask_name); },
                    pixels.values);
}

MaskFile read_mask(const fs::path& path) {
  return decode_mask(read_file_or_stdin(path, "mask", kMaxFileBytes), path.string());
}

}  // namespace itn
