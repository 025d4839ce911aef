#include "client/image/encoded_pixels.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <exception>
#include <memory>
#include <mutex>
#include <utility>

namespace itn {
namespace {

const char* format_of_openimageio(ImageFormat format) {
  switch (format) {
    case ImageFormat::kJpeg: return "jpeg";
    case ImageFormat::kTiff: return "tiff";
    default: return "webp";
  }
}

// A JPEG, TIFF or WebP file in memory that OpenImageIO has open.
class OpenImage {
 public:
  OpenImage(std::string_view bytes, const PhotographHeader& header, const std::string& name)
      : header_(header),
        name_(name),
        memory_(bytes.data(), bytes.size()),
        input_(OIIO::ImageInput::create(format_of_openimageio(header.format))) {
    if (!input_) {
      throw invalid_input(
          fmt::format("{} is {}, which OpenImageIO as it is installed does not "
                      "read: {}",
                      name, header.format_name, OIIO::geterror()));
    }
    input_->set_ioproxy(&memory_);
    OIIO::ImageSpec wanted;
    wanted.attribute("oiio:UnassociatedAlpha", 1);
    if (!input_->open(name, spec_, wanted)) throw failure();
  }

  const OIIO::ImageSpec& spec() const { return spec_; }

  template <typename T>
  std::vector<T> values(OIIO::TypeDesc type) {
    std::vector<T> values(static_cast<size_t>(spec_.image_pixels()) *
                          static_cast<size_t>(spec_.nchannels));
    // It says so too where it found something wrong and went on.
    if (!input_->read_image(0, 0, 0, spec_.nchannels, type, values.data()) || input_->has_error()) {
      throw failure();
    }
    return values;
  }

 private:
  Error failure() { return damaged(name_, header_, input_->geterror()); }

  const PhotographHeader& header_;
  const std::string& name_;
  OIIO::Filesystem::IOMemReader memory_;
  std::unique_ptr<OIIO::ImageInput> input_;
  OIIO::ImageSpec spec_;
};

// Keeps gray or RGB, and alpha; files may have more.
template <typename T>
std::vector<T> chosen(std::vector<T> values, int channels, const std::vector<int>& wanted) {
  if (static_cast<int>(wanted.size()) == channels) return values;
  std::vector<T> kept;
  kept.reserve(values.size() / static_cast<size_t>(channels) * wanted.size());
  for (size_t pixel = 0; pixel < values.size(); pixel += static_cast<size_t>(channels)) {
    for (const int channel : wanted) kept.push_back(values[pixel + static_cast<size_t>(channel)]);
  }
  return kept;
}

ColourEncoding encoding_of(const OIIO::ImageSpec& spec, const PhotographHeader& header) {
  ColourEncoding encoding;
  encoding.profile = header.profile;
  if (const auto* profile = spec.find_attribute("ICCProfile")) {
    encoding.profile.assign(static_cast<const char*>(profile->data()), profile->type().size());
  }
  if (spec.format.is_floating_point()) encoding.curve = ColourEncoding::Curve::kLinear;
  encoding.is_stated = spec.format != OIIO::TypeDesc::UINT16;
  return encoding;
}

EncodedPixels decode(std::string_view bytes, const PhotographHeader& header,
                     const std::string& name) {
  OpenImage image(bytes, header, name);
  const OIIO::ImageSpec& spec = image.spec();
  if (spec.width != header.width || spec.height != header.height) {
    throw damaged(name, header, "its parts disagree about its size");
  }
  const int alpha = spec.alpha_channel;
  const int colours = spec.nchannels - (alpha >= 0 ? 1 : 0) >= 3 ? 3 : 1;
  std::vector<int> wanted;
  for (int channel = 0; static_cast<int>(wanted.size()) < colours; ++channel) {
    if (channel != alpha) wanted.push_back(channel);
  }
  if (alpha >= 0) wanted.push_back(alpha);

  EncodedPixels pixels{
      .width = spec.width,
      .height = spec.height,
      .channels = static_cast<int>(wanted.size()),
      .values = {},
      .encoding = encoding_of(spec, header),
      .multiplied_by_alpha = alpha >= 0 && spec.get_int_attribute("oiio:UnassociatedAlpha") == 0,
      .exif = header.exif};
  if (spec.format == OIIO::TypeDesc::UINT8) {
    pixels.values = chosen(image.values<uint8_t>(OIIO::TypeDesc::UINT8), spec.nchannels, wanted);
  } else if (spec.format == OIIO::TypeDesc::UINT16) {
    pixels.values = chosen(image.values<uint16_t>(OIIO::TypeDesc::UINT16), spec.nchannels, wanted);
  } else if (spec.format.is_floating_point()) {
    pixels.values = chosen(image.values<float>(OIIO::TypeDesc::FLOAT), spec.nchannels, wanted);
  } else {
    throw invalid_input(fmt::format(
        "{} holds values of type {}; unsigned integers of 8 or 16 bits, or floating-point numbers, "
        "are read",
        name, spec.format.c_str()));
  }
  return pixels;
}

EncodedPixels decode_by_format(std::string_view bytes, const PhotographHeader& header,
                               const std::string& name) {
  if (header.format == ImageFormat::kPng) return decode_png_pixels(bytes, header, name);
  if (header.format == ImageFormat::kHeif) return decode_heif_pixels(bytes, header, name);
  // Threads of OpenImageIO's own would be more than were asked for.
  static std::once_flag once;
  std::call_once(once, [] { OIIO::attribute("threads", 1); });
  try {
    return decode(bytes, header, name);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {  // of OpenImageIO and what it stands on
    throw damaged(name, header, error.what());
  }
}

}  // namespace

Error damaged(const std::string& name, const PhotographHeader& header, const std::string& reason) {
  return {ErrorKind::kDataLoss, fmt::format("{} begins as {} and is not a complete one: {}", name,
                                            header.format_name, reason)};
}

EncodedPixels decode_pixels(std::string_view bytes, const PhotographHeader& header,
                            const std::string& name) {
  EncodedPixels pixels = decode_by_format(bytes, header, name);
  const int colours = pixels.channels - (pixels.has_alpha() ? 1 : 0);
  const bool says_nothing = pixels.encoding.profile.empty() && !pixels.encoding.primaries;
  if (!pixels.exif.is_srgb && says_nothing && colours == 3) {
    spdlog::warn(
        "{}: its EXIF says that its colours are not those of sRGB, and no profile says which they "
        "are; they are taken for sRGB",
        name);
  }
  pixels.encoding = simplified(std::move(pixels.encoding), colours, name);
  return pixels;
}

}  // namespace itn
