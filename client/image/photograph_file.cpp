#include "client/image/photograph_file.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <sstream>
#include <type_traits>
#include <variant>

#include "client/image/attributes.h"
#include "client/image/channels.h"
#include "client/image/encoded_pixels.h"
#include "client/image/image_format.h"
#include "client/image/upright.h"
#include "common/error.h"
#include "common/files/read_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

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

Upright upright(const EncodedPixels& pixels) {
  return {pixels.exif.orientation, pixels.width, pixels.height};
}

// Linear light of every value that T can have; of floating-point numbers nothing.
template <typename T>
std::vector<float> curve(const ColourEncoding& encoding) {
  if constexpr (std::is_floating_point_v<T>) {
    return {};
  } else {
    std::vector<float> light(size_t{std::numeric_limits<T>::max()} + 1);
    for (size_t i = 0; i < light.size(); ++i) {
      const double encoded = static_cast<double>(i) / kTop<T>;
      const bool later = !encoding.profile.empty();
      light[i] = static_cast<float>(later ? encoded : linear_of(encoding, encoded));
    }
    return light;
  }
}

// Linear light of a value. Files that have multiplied it by alpha did so before the curve.
template <typename T>
float light_of(T value, T alpha, bool divide, const ColourEncoding& encoding,
               const std::vector<float>& curve) {
  if constexpr (std::is_floating_point_v<T>) {
    const double divided = divide && alpha > 0 ? double{value} / double{alpha} : double{value};
    const bool is_encoded =
        encoding.profile.empty() && divided > 0 && encoding.curve != ColourEncoding::Curve::kLinear;
    return static_cast<float>(is_encoded ? linear_of(encoding, divided) : divided);
  } else {
    if (!divide || alpha == 0) return curve[value];
    const double divided = std::min(kTop<T>, std::round(kTop<T> * value / alpha));
    return curve[static_cast<size_t>(divided)];
  }
}

// Planes of colours, encoded by a profile or of other primaries than sRGB's, become linear sRGB.
void convert_colours(const ColourEncoding& encoding, const std::vector<std::string>& names,
                     Image& image, const std::string& name) {
  if (encoding.profile.empty() && !(encoding.primaries && names.size() == 3)) return;
  const size_t count = image.channels.at(names[0]).size();
  const ColourConversion convert =
      conversion_to_linear_srgb(encoding, static_cast<int>(names.size()), name);
  constexpr size_t kAtATime = 65536;  // pixels
  std::vector<float> colours;
  for (size_t first = 0; first < count; first += kAtATime) {
    const size_t end = std::min(count, first + kAtATime);
    colours.clear();
    for (size_t pixel = first; pixel < end; ++pixel) {
      for (const std::string& channel : names) colours.push_back(image.channels[channel][pixel]);
    }
    convert(colours);
    auto colour = colours.begin();
    for (size_t pixel = first; pixel < end; ++pixel) {
      for (const std::string& channel : names) image.channels[channel][pixel] = *colour++;
    }
  }
}

template <typename T>
Image to_linear(const EncodedPixels& pixels, const std::vector<T>& values,
                const std::string& name) {
  const Upright turned = upright(pixels);
  Image image{.width = turned.width(), .height = turned.height(), .channels = {}, .attributes = {}};
  const std::vector<float> table = curve<T>(pixels.encoding);
  const auto channels = static_cast<size_t>(pixels.channels);
  const size_t colours = channels - (pixels.has_alpha() ? 1 : 0);
  const size_t count = values.size() / channels;
  const std::vector<std::string> names =
      colours == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B"};
  for (size_t channel = 0; channel < colours; ++channel) {
    std::vector<float>& plane = image.channels[names[channel]];
    plane.resize(count);
    turned.for_each([&](size_t pixel, size_t source) {
      const T* value = &values[source * channels];
      plane[pixel] = light_of(value[channel], value[channels - 1], pixels.multiplied_by_alpha,
                              pixels.encoding, table);
    });
  }
  convert_colours(pixels.encoding, names, image, name);
  if (pixels.has_alpha()) {
    std::vector<float>& plane = image.channels["A"];
    plane.resize(count);
    turned.for_each([&](size_t pixel, size_t source) {
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
  const PhotographHeader header = read_photograph_header(bytes, name);
  if (header.pages > 1) spdlog::warn("{} has {} pages; the first is read", name, header.pages);
  return decode_pixels(bytes, header, name);
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

// An OpenEXR or Radiance HDR image, which is linear; none if it is of another format.
std::optional<Image> decode_linear(std::string_view bytes, const std::string& name) {
  switch (recognize_format(bytes).format) {
    case ImageFormat::kExr: return decode_exr(bytes, name);
    case ImageFormat::kHdr: return decode_hdr(bytes, name);
    default: return std::nullopt;
  }
}

// In each of its layers that have R, G and B.
void convert_layers(Image& image, const std::string& name) {
  const auto found = image.attributes.find(attribute::kChromaticities);
  if (found == image.attributes.end()) return;
  ColourEncoding encoding{.curve = ColourEncoding::Curve::kLinear};
  std::istringstream numbers(std::get<std::string>(found->second));
  for (double& number : encoding.primaries.emplace()) numbers >> number;
  for (const auto& [channel, plane] : image.channels) {
    if (channel != "R" && !channel.ends_with(".R")) continue;
    const std::string layer = channel.substr(0, channel.size() - 1);
    const std::vector<std::string> names{layer + "R", layer + "G", layer + "B"};
    if (image.has(names[1]) && image.has(names[2])) convert_colours(encoding, names, image, name);
  }
  image.attributes.erase(found);
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
  const Upright turned = upright(pixels);
  const auto channels = static_cast<size_t>(pixels.channels);
  const bool by_alpha = pixels.has_alpha() && alpha_varies(values, channels);
  MaskFile mask{.width = turned.width(),
                .height = turned.height(),
                .values = std::vector<float>(values.size() / channels),
                .turned = pixels.exif.orientation != 1};
  turned.for_each([&](size_t pixel, size_t source) {
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

PhotographFile decode_photograph(std::string_view bytes, const std::string& name,
                                 std::optional<bool> is_linear) {
  if (auto linear = decode_linear(bytes, name)) {
    if (is_linear == false) {
      throw invalid_input(fmt::format(
          "{} is an OpenEXR or Radiance HDR image, which is linear and not sRGB", name));
    }
    PhotographFile file;
    file.image = std::move(*linear);
    convert_layers(file.image, name);
    restore_unmerged_attributes(file);
    return file;
  }
  EncodedPixels pixels = pixels_of(bytes, name);
  if (is_linear) {
    pixels.encoding = {
        .curve = *is_linear ? ColourEncoding::Curve::kLinear : ColourEncoding::Curve::kSrgb,
        .is_stated = true};
  }
  PhotographFile file = std::visit(
      [&]<typename T>(const std::vector<T>& values) {
        return PhotographFile{.image = to_linear(pixels, values, name),
                              .clipped = clipped_pixels(pixels, values),
                              .encoded = pixels.encoding.curve != ColourEncoding::Curve::kLinear,
                              .may_be_linear = !pixels.encoding.is_stated,
                              .turned = pixels.exif.orientation != 1,
                              .exposure_seconds = pixels.exif.exposure_seconds,
                              .f_number = pixels.exif.f_number,
                              .iso = pixels.exif.iso,
                              .focal_length_35mm = pixels.exif.focal_length_35mm};
      },
      pixels.values);
  check_finite(file.image, name);
  return file;
}

PhotographFile read_photograph(const fs::path& path, std::optional<bool> is_linear) {
  return decode_photograph(read_file_or_stdin(path, "photograph", kMaxImageFileBytes),
                           path.string(), is_linear);
}

void warn_if_taken_for_srgb(const PhotographFile& file, const std::string& name) {
  if (!file.may_be_linear) return;
  spdlog::warn(
      "{}: 16-bit integers that do not say how they are encoded were taken for sRGB; --encoding "
      "linear if they were developed as linear",
      name);
}

MaskFile decode_mask(std::string_view bytes, const std::string& name) {
  const std::string mask_name = "the mask " + name;
  if (auto image = decode_linear(bytes, mask_name)) {
    return {image->width, image->height,
            std::move(image->channels[mask_channel(*image, mask_name)])};
  }
  const EncodedPixels pixels = pixels_of(bytes, mask_name);
  return std::visit([&](const auto& values) { return mask_of(pixels, values, mask_name); },
                    pixels.values);
}

MaskFile read_mask(const fs::path& path) {
  return decode_mask(read_file_or_stdin(path, "mask", kMaxImageFileBytes), path.string());
}

}  // namespace itn
