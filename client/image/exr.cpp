// OpenEXR files. What a header claims is checked against the size of the file before OpenEXR
// allocates anything for it.
#include <ImfChannelList.h>
#include <ImfDoubleAttribute.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfIntAttribute.h>
#include <ImfMultiPartInputFile.h>
#include <ImfOutputFile.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>
#include <ImfTileDescription.h>
#include <ImfTileDescriptionAttribute.h>
#include <ImfVersion.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <exception>
#include <map>
#include <optional>
#include <type_traits>
#include <utility>

#include "client/image/attributes.h"
#include "client/image/image.h"
#include "client/image/image_format.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr int64_t kMaxPixels = int64_t{1} << 28;
// All channels together: 4 GiB of floats.
constexpr int64_t kMaxValues = int64_t{1} << 30;
// OpenEXR holds up to 256 lines at a time, however many the image has.
constexpr int64_t kMaxLineBytes = int64_t{1} << 21;
constexpr uint32_t kMaxTileSide = 2048;
// Deflate makes data 1032 times smaller at most. The lossy DWA can do better where an image is
// constant, so small images may.
constexpr int64_t kMaxCompression = 1032;
constexpr int64_t kAlwaysAcceptedBytes = int64_t{64} << 20;

Error damaged(const std::string& name, const std::string& reason) {
  return Error(ErrorKind::kDataLoss,
               fmt::format("{} is not a complete OpenEXR image: {}", name, reason));
}

class MemoryStream final : public Imf::IStream {
 public:
  MemoryStream(std::string_view bytes, const std::string& name)
      : Imf::IStream(name.c_str()), bytes_(bytes) {}

  bool isMemoryMapped() const override { return false; }
  bool read(char to[], int count) override {
    if (count < 0 || static_cast<uint64_t>(count) > bytes_.size() - at_) {
      throw Iex::InputExc("it was cut short");
    }
    std::memcpy(to, bytes_.data() + at_, static_cast<size_t>(count));
    at_ += static_cast<uint64_t>(count);
    return at_ < bytes_.size();
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t position) override {
    if (position > bytes_.size()) throw Iex::InputExc("it was cut short");
    at_ = position;
  }

 private:
  std::string_view bytes_;
  uint64_t at_ = 0;
};

// --- What a header claims ---

// The entries of headers: name, type and size of each must lie within the file, as OpenEXR
// allocates before it reads. Files of several parts have a header each, and an empty one behind.
void check_entries(std::string_view bytes, bool several_parts, const std::string& name) {
  const auto text = [&](size_t& offset) {
    const size_t end = bytes.find('\0', offset);
    if (end == std::string_view::npos) throw damaged(name, "its header has no end");
    const std::string_view found = bytes.substr(offset, end - offset);
    offset = end + 1;
    return found;
  };
  size_t offset = 8;  // behind magic number and version
  for (bool is_last = false; !is_last;) {
    const size_t begin = offset;
    while (!text(offset).empty()) {
      text(offset);  // the type
      uint32_t size = 0;
      if (bytes.size() - offset < sizeof size) throw damaged(name, "its header has no end");
      std::memcpy(&size, bytes.data() + offset, sizeof size);  // little-endian, as all our machines
      offset += sizeof size;
      if (size > bytes.size() - offset) {
        throw damaged(name, fmt::format("its header claims an entry of {} bytes", size));
      }
      offset += size;
    }
    is_last = !several_parts || offset == begin + 1;
  }
}

// Returns the flags of the format that the file has.
uint32_t check_version(std::string_view bytes, const std::string& name) {
  const auto [format, format_name] = recognize_format(bytes);
  if (format != ImageFormat::kExr && format != ImageFormat::kUnknown) {
    throw invalid_input(fmt::format(
        "{} is {}; it must be an OpenEXR image (.exr) of linear radiance, as photographs "
        "that are developed for a display are not",
        name, format_name));
  }
  if (bytes.size() < 8 || format != ImageFormat::kExr) {
    throw damaged(name, bytes.empty() ? "it is empty" : "it does not begin as one");
  }
  uint32_t version = 0;
  std::memcpy(&version, bytes.data() + 4, sizeof version);  // behind the magic number
  if (version & Imf::NON_IMAGE_FLAG) {
    throw invalid_input(
        fmt::format("{} holds deep data; only files with ordinary pixels are accepted", name));
  }
  return version;
}

// The bytes of one pixel, in the file.
int64_t bytes_per_pixel(const Imf::Header& header, const std::string& name) {
  int64_t bytes = 0;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    if (it.channel().xSampling != 1 || it.channel().ySampling != 1) {
      throw invalid_input(fmt::format(
          "channel {} of {} is subsampled; only channels of full resolution are accepted",
          it.name(), name));
    }
    bytes += it.channel().type == Imf::HALF ? 2 : 4;
  }
  return bytes;
}

int64_t channel_count(const Imf::Header& header) {
  int64_t count = 0;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) ++count;
  return count;
}

// Lines or tiles are stored in chunks, each with an entry of 8 bytes in a table, and 8 or more
// before its pixels.
int64_t least_bytes_of_chunks(const Imf::Header& header, int64_t width, int64_t height,
                              const std::string& name) {
  constexpr int64_t kMaxLinesOfAChunk = 256;
  int64_t chunks = (height + kMaxLinesOfAChunk - 1) / kMaxLinesOfAChunk;
  if (const auto* tiles = header.findTypedAttribute<Imf::TileDescriptionAttribute>("tiles")) {
    const Imf::TileDescription& tile = tiles->value();
    if (tile.xSize < 1 || tile.xSize > kMaxTileSide || tile.ySize < 1 ||
        tile.ySize > kMaxTileSide) {
      throw invalid_input(
          fmt::format("{} has tiles of {} x {} pixels; at most {} x {} are accepted", name,
                      tile.xSize, tile.ySize, kMaxTileSide, kMaxTileSide));
    }
    chunks = ((width + tile.xSize - 1) / tile.xSize) * ((height + tile.ySize - 1) / tile.ySize);
  }
  return 16 * chunks;
}

// What the image has: the display window, black where the file has no pixels. Where that is none,
// the pixels that there are.
Imath::Box2i image_window(const Imf::Header& header) {
  return header.displayWindow().isEmpty() ? header.dataWindow() : header.displayWindow();
}

// Its number of pixels.
int64_t pixels_in(const Imath::Box2i& window, const std::string& name) {
  const int64_t width = int64_t{window.max.x} - window.min.x + 1;
  const int64_t height = int64_t{window.max.y} - window.min.y + 1;
  if (width < 1 || height < 1 || width > kMaxPixels || height > kMaxPixels / width) {
    throw invalid_input(
        fmt::format("{} has {} x {} pixels; at most 2^28 are accepted", name, width, height));
  }
  return width * height;
}

void check_claims(const Imf::Header& header, size_t file_bytes, const std::string& name) {
  if (!(std::abs(header.pixelAspectRatio() - 1) <= 1e-3F)) {
    throw invalid_input(
        fmt::format("the pixels of {} are not square, but {:.4g} times as wide as high "
                    "(pixelAspectRatio); resample it",
                    name, header.pixelAspectRatio()));
  }
  const Imath::Box2i window = header.dataWindow();
  const int64_t pixels = std::max(pixels_in(window, name), pixels_in(image_window(header), name));
  const int64_t width = int64_t{window.max.x} - window.min.x + 1;
  const int64_t height = int64_t{window.max.y} - window.min.y + 1;
  const int64_t pixel_bytes = bytes_per_pixel(header, name);
  const int64_t channels = channel_count(header);
  if (channels > kMaxValues / pixels) {
    throw invalid_input(
        fmt::format("{} holds {} values; at most 2^30 are accepted", name, channels * pixels));
  }
  if (width * pixel_bytes > kMaxLineBytes) {
    throw invalid_input(fmt::format("{} has lines of {} bytes; at most {} are accepted", name,
                                    width * pixel_bytes, kMaxLineBytes));
  }
  const auto size = static_cast<int64_t>(file_bytes);
  const int64_t claimed = pixels * pixel_bytes;
  if (least_bytes_of_chunks(header, width, height, name) > size ||
      claimed > std::max(kAlwaysAcceptedBytes, kMaxCompression * size)) {
    throw damaged(name, fmt::format("it was cut short: its header claims {} x {} pixels of {} "
                                    "channels, the file has {} bytes",
                                    width, height, channels, size));
  }
}

// --- Pixels ---

// OpenEXR addresses pixels in the coordinates of the data window: its base may be far from memory.
Imf::Slice slice(const std::vector<float>& plane, int width, Imath::V2i origin = {0, 0}) {
  const auto row = static_cast<int64_t>(sizeof(float)) * width;
  const int64_t offset = origin.y * row + origin.x * static_cast<int64_t>(sizeof(float));
  const auto base = reinterpret_cast<uintptr_t>(plane.data()) - static_cast<uintptr_t>(offset);
  return {Imf::FLOAT, reinterpret_cast<char*>(base), sizeof(float), static_cast<size_t>(row)};
}

// --- Attributes ---

std::optional<Attribute> from_exr(const Imf::Attribute& attribute) {
  if (const auto* text = dynamic_cast<const Imf::StringAttribute*>(&attribute)) {
    return text->value();
  }
  if (const auto* integer = dynamic_cast<const Imf::IntAttribute*>(&attribute)) {
    return integer->value();
  }
  if (const auto* number = dynamic_cast<const Imf::DoubleAttribute*>(&attribute)) {
    return number->value();
  }
  if (const auto* number = dynamic_cast<const Imf::FloatAttribute*>(&attribute)) {
    return double{number->value()};
  }
  return std::nullopt;
}

void insert(Imf::Header& header, const std::string& name, const Attribute& attribute) {
  std::visit(
      [&](const auto& value) {
        header.insert(name, Imf::TypedAttribute<std::decay_t<decltype(value)>>(value));
      },
      attribute);
}

void read_attributes(const Imf::Header& header, Image& image) {
  const Imf::Header standard;  // its entries are OpenEXR's own
  for (auto it = header.begin(); it != header.end(); ++it) {
    if (standard.find(it.name()) != standard.end()) continue;
    if (const auto attribute = from_exr(it.attribute())) image.attributes[it.name()] = *attribute;
  }
  if (!Imf::hasChromaticities(header)) return;
  const Imf::Chromaticities &c = Imf::chromaticities(header), of_srgb;
  const auto same = [](Imath::V2f a, Imath::V2f b) { return (a - b).length() < 0.003F; };
  if (same(c.red, of_srgb.red) && same(c.green, of_srgb.green) && same(c.blue, of_srgb.blue) &&
      same(c.white, of_srgb.white)) {
    return;
  }
  image.attributes[attribute::kChromaticities] =
      fmt::format("{} {} {} {} {} {} {} {}", c.red.x, c.red.y, c.green.x, c.green.y, c.blue.x,
                  c.blue.y, c.white.x, c.white.y);
}

// All channels of a part, under their own names with `prefix`.
void read_part(Imf::InputPart part, const std::string& prefix, Image& image) {
  const Imath::Box2i data = part.header().dataWindow(), window = image_window(part.header());
  const int width = data.max.x - data.min.x + 1, height = data.max.y - data.min.y + 1;
  Imf::FrameBuffer buffer;
  const Imf::ChannelList& channels = part.header().channels();
  std::map<std::string, std::vector<float>> planes;
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    std::vector<float>& plane = planes[it.name()];
    plane.resize(static_cast<size_t>(width) * static_cast<size_t>(height));
    buffer.insert(it.name(), slice(plane, width, data.min));
  }
  part.setFrameBuffer(buffer);
  part.readPixels(data.min.y, data.max.y);
  for (auto& [name, plane] : planes) {
    std::vector<float>& whole = image.channels[prefix + name];
    if (data == window) {
      whole = std::move(plane);
      continue;
    }
    whole.assign(static_cast<size_t>(image.width) * static_cast<size_t>(image.height), 0);
    for (int y = std::max(data.min.y, window.min.y); y <= std::min(data.max.y, window.max.y); ++y) {
      for (int x = std::max(data.min.x, window.min.x); x <= std::min(data.max.x, window.max.x);
           ++x) {
        whole[static_cast<size_t>(y - window.min.y) * static_cast<size_t>(image.width) +
              static_cast<size_t>(x - window.min.x)] =
            plane[static_cast<size_t>(y - data.min.y) * static_cast<size_t>(width) +
                  static_cast<size_t>(x - data.min.x)];
      }
    }
  }
}

Image decode(std::string_view bytes, const std::string& name) {
  const uint32_t version = check_version(bytes, name);
  const bool several_parts = (version & Imf::MULTI_PART_FILE_FLAG) != 0;
  check_entries(bytes, several_parts, name);
  MemoryStream stream(bytes, name);
  stream.seekg(8);
  std::vector<Imf::Header> headers;
  do {
    int flags = static_cast<int>(version);
    headers.emplace_back().readFrom(stream, flags);
  } while (several_parts && bytes.at(stream.tellg()) != '\0');
  for (const Imf::Header& header : headers) check_claims(header, bytes.size(), name);

  stream.seekg(0);
  Imf::MultiPartInputFile file(stream);
  const Imath::Box2i window = image_window(file.header(0));
  Image image;
  image.width = window.max.x - window.min.x + 1;
  image.height = window.max.y - window.min.y + 1;
  read_attributes(headers[0], image);  // OpenEXR adds some of its own to the file's
  if (file.parts() > 1) {
    spdlog::warn("{} has {} parts; the first one is meant where no layer is named", name,
                 file.parts());
  }
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    const bool is_flat = !header.hasType() || Imf::isImage(header.type());
    if (part > 0 && (!is_flat || image_window(header) != window)) continue;
    if (!is_flat) {
      throw invalid_input(
          fmt::format("{} holds deep data; only files with ordinary pixels are accepted", name));
    }
    if (!file.partComplete(part)) throw damaged(name, "it was cut short");
    const bool is_named = part > 0 && header.hasName();
    read_part({file, part},
              is_named   ? header.name() + "."
              : part > 0 ? std::to_string(part) + "."
                         : "",
              image);
  }
  return image;
}

std::string encode(const Image& image) {
  Imf::Header header(image.width, image.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  Imf::FrameBuffer buffer;
  for (const auto& [name, plane] : image.channels) {
    if (plane.size() != static_cast<size_t>(image.width) * static_cast<size_t>(image.height)) {
      throw Error(ErrorKind::kInternal, fmt::format("channel {} has {} values, not {} x {}", name,
                                                    plane.size(), image.width, image.height));
    }
    header.channels().insert(name, Imf::Channel(Imf::FLOAT));
    buffer.insert(name, slice(plane, image.width));
  }
  for (const auto& [name, attribute] : image.attributes) insert(header, name, attribute);
  Imf::StdOSStream stream;
  {
    Imf::OutputFile file(stream, header);
    file.setFrameBuffer(buffer);
    file.writePixels(image.height);
  }  // its end completes the file
  return stream.str();
}

}  // namespace

Image decode_exr(std::string_view bytes, const std::string& name) {
  try {
    Image image = decode(bytes, name);
    check_finite(image, name);
    return image;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {  // of OpenEXR
    throw damaged(name, error.what());
  }
}

Image read_exr(const fs::path& path) {
  return decode_exr(read_file(path, "image", kMaxImageFileBytes), path.string());
}

void write_exr(const fs::path& path, const Image& image) {
  std::string bytes;
  try {
    bytes = encode(image);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {  // of OpenEXR
    throw Error(ErrorKind::kInternal,
                fmt::format("cannot encode {}: {}", path.string(), error.what()));
  }
  write_file_atomically(path, bytes);
}

}  // namespace itn
