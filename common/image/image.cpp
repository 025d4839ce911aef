#include "common/image/image.h"

#include <Iex.h>
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <png.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <ranges>

#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr int64_t kMaxPixels = int64_t{1} << 28;
// All channels together: 4 GiB of floats.
constexpr int64_t kMaxValues = int64_t{1} << 30;

Error damaged(const fs::path& path, const std::string& reason) {
  return Error(ErrorKind::kDataLoss,
               fmt::format("{} is not a complete OpenEXR image: {}", path.string(), reason));
}

void check_readable(const fs::path& path) {
  if (!fs::is_regular_file(path) || !std::ifstream(path).good()) {
    throw Error(ErrorKind::kIo, fmt::format("cannot open the image {}", path.string()));
  }
}

// Sizes `image` after the header, once that is found to be acceptable.
void allocate(Image& image, const Imf::Header& header, const fs::path& path) {
  const Imath::Box2i window = header.dataWindow();
  const int64_t width = int64_t{window.max.x} - window.min.x + 1;
  const int64_t height = int64_t{window.max.y} - window.min.y + 1;
  if (width < 1 || height < 1 || width > kMaxPixels || height > kMaxPixels / width) {
    throw invalid_input(fmt::format("{} has {} x {} pixels; at most 2^28 are accepted",
                                    path.string(), width, height));
  }
  int64_t values = 0;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    if (it.channel().xSampling != 1 || it.channel().ySampling != 1) {
      throw invalid_input(fmt::format(
          "channel {} of {} is subsampled; only channels of full resolution are accepted",
          it.name(), path.string()));
    }
    values += width * height;
  }
  if (values > kMaxValues) {
    throw invalid_input(
        fmt::format("{} holds {} values; at most 2^30 are accepted", path.string(), values));
  }
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    image.channels[it.name()].resize(static_cast<size_t>(width * height));
  }
}

// OpenEXR addresses pixels in the coordinates of the data window.
Imf::Slice slice(const std::vector<float>& plane, int width, Imath::V2i origin = {0, 0}) {
  auto* first = reinterpret_cast<char*>(const_cast<float*>(plane.data()));
  const auto row = static_cast<ptrdiff_t>(sizeof(float)) * width;
  char* base = first - origin.y * row - origin.x * static_cast<ptrdiff_t>(sizeof(float));
  return {Imf::FLOAT, base, sizeof(float), static_cast<size_t>(row)};
}

void check_finite(const Image& image, const fs::path& path) {
  for (const auto& [name, plane] : image.channels) {
    for (size_t i = 0; i < plane.size(); ++i) {
      if (std::isfinite(plane[i])) continue;
      const auto width = static_cast<size_t>(image.width);
      throw invalid_input(
          fmt::format("{}: channel {} is {} at pixel x = {}, y = {} (counted from the top left); "
                      "every value must be finite",
                      path.string(), name, plane[i], i % width, i / width));
    }
  }
}

}  // namespace

const std::vector<float>& Image::channel(const std::string& name) const {
  const auto it = channels.find(name);
  if (it != channels.end()) return it->second;
  throw invalid_input(fmt::format("the image has no channel {}; it has: {}", name,
                                  fmt::join(channels | std::views::keys, ", ")));
}

Image read_exr(const fs::path& path) {
  check_readable(path);
  Image image;
  try {
    Imf::InputFile file(path.c_str());
    const Imf::Header& header = file.header();
    if (!file.isComplete()) throw damaged(path, "it was cut short");
    allocate(image, header, path);
    for (auto it = header.begin(); it != header.end(); ++it) {
      if (const auto* text = dynamic_cast<const Imf::StringAttribute*>(&it.attribute())) {
        image.attributes[it.name()] = text->value();
      }
    }
    const Imath::Box2i window = header.dataWindow();
    Imf::FrameBuffer buffer;
    for (const auto& [name, plane] : image.channels) {
      buffer.insert(name, slice(plane, image.width, window.min));
    }
    file.setFrameBuffer(buffer);
    file.readPixels(window.min.y, window.max.y);
  } catch (const Iex::BaseExc& e) {
    throw damaged(path, e.what());
  }
  check_finite(image, path);
  return image;
}

void write_exr(const fs::path& path, const Image& image) {
  AtomicFile target(path);
  try {
    Imf::Header header(image.width, image.height);
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::FrameBuffer buffer;
    for (const auto& [name, plane] : image.channels) {
      if (plane.size() != static_cast<size_t>(image.width) * static_cast<size_t>(image.height)) {
        throw Error(ErrorKind::kInternal,
                    fmt::format("channel {} of {} has {} values, not {} x {}", name, path.string(),
                                plane.size(), image.width, image.height));
      }
      header.channels().insert(name, Imf::Channel(Imf::FLOAT));
      buffer.insert(name, slice(plane, image.width));
    }
    for (const auto& [name, text] : image.attributes) {
      header.insert(name, Imf::StringAttribute(text));
    }
    Imf::OutputFile file(target.temporary().c_str(), header);
    file.setFrameBuffer(buffer);
    file.writePixels(image.height);
  } catch (const Iex::BaseExc& e) {
    throw Error(ErrorKind::kIo, fmt::format("cannot write {}: {}", path.string(), e.what()));
  }
  target.commit();
}

void write_png(const fs::path& path, int width, int height, std::span<const unsigned char> rgb) {
  if (width < 1 || height < 1 ||
      rgb.size() != 3 * static_cast<size_t>(width) * static_cast<size_t>(height)) {
    throw Error(ErrorKind::kInternal, fmt::format("{} bytes are not {} x {} pixels of 3 bytes",
                                                  rgb.size(), width, height));
  }
  AtomicFile target(path);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(width);
  png.height = static_cast<png_uint_32>(height);
  png.format = PNG_FORMAT_RGB;
  if (!png_image_write_to_file(&png, target.temporary().c_str(), 0, rgb.data(), 0, nullptr)) {
    throw Error(ErrorKind::kIo, fmt::format("cannot write {}: {}", path.string(), png.message));
  }
  target.commit();
}

}  // namespace itn
