// OpenEXR files. What a header claims is checked against the size of the file before OpenEXR
// allocates anything for it.
#include <ImfChannelList.h>
#include <ImfDoubleAttribute.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfIntAttribute.h>
#include <ImfOutputFile.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>
#include <ImfTileDescription.h>
#include <ImfTileDescriptionAttribute.h>
#include <ImfVersion.h>
#include <fmt/format.h>

#include <cstdint>
#include <cstring>
#include <exception>
#include <optional>
#include <type_traits>

#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/image/image.h"
#include "common/image/image_format.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr int64_t kMaxPixels = int64_t{1} << 28;
// All channels together: 4 GiB of floats.
constexpr int64_t kMaxValues = int64_t{1} << 30;
// A file of so many uncompressed values, and its header.
constexpr uint64_t kMaxFileBytes = (uint64_t{1} << 32) + (uint64_t{1} << 24);
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

// The entries of a header: name, type and size of each must lie within the file, as OpenEXR
// allocates before it reads.
void check_entries(std::string_view bytes, const std::string& name) {
  const auto text = [&](size_t& at) {
    const size_t end = bytes.find('\0', at);
    if (end == std::string_view::npos) throw damaged(name, "its header has no end");
    const std::string_view found = bytes.substr(at, end - at);
    at = end + 1;
    return found;
  };
  size_t at = 8;  // behind magic number and version
  while (!text(at).empty()) {
    text(at);  // the type
    uint32_t size = 0;
    if (bytes.size() - at < sizeof size) throw damaged(name, "its header has no end");
    std::memcpy(&size, bytes.data() + at, sizeof size);  // little-endian, as all machines we run on
    at += sizeof size;
    if (size > bytes.size() - at) {
      throw damaged(name, fmt::format("its header claims an entry of {} bytes", size));
    }
    at += size;
  }
}

void check_version(std::string_view bytes, const std::string& name) {
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
  if (version & (Imf::NON_IMAGE_FLAG | Imf::MULTI_PART_FILE_FLAG)) {
    throw invalid_input(
        fmt::format("{} holds {}; only files of one part with ordinary pixels are accepted", name,
                    version & Imf::NON_IMAGE_FLAG ? "deep data" : "several parts"));
  }
}

// Of one pixel, in the file.
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

void check_claims(const Imf::Header& header, size_t file_bytes, const std::string& name) {
  const Imath::Box2i window = header.dataWindow();
  const int64_t width = int64_t{window.max.x} - window.min.x + 1;
  const int64_t height = int64_t{window.max.y} - window.min.y + 1;
  if (width < 1 || height < 1 || width > kMaxPixels || height > kMaxPixels / width) {
    throw invalid_input(
        fmt::format("{} has {} x {} pixels; at most 2^28 are accepted", name, width, height));
  }
  const int64_t pixel_bytes = bytes_per_pixel(header, name);
  const int64_t channels = channel_count(header);
  if (channels > kMaxValues / (width * height)) {
    throw invalid_input(fmt::format("{} holds {} values; at most 2^30 are accepted", name,
                                    channels * width * height));
  }
  if (width * pixel_bytes > kMaxLineBytes) {
    throw invalid_input(fmt::format("{} has lines of {} bytes; at most {} are accepted", name,
                                    width * pixel_bytes, kMaxLineBytes));
  }
  const auto size = static_cast<int64_t>(file_bytes);
  const int64_t claimed = width * height * pixel_bytes;
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

Image decode(std::string_view bytes, const std::string& name) {
  check_version(bytes, name);
  check_entries(bytes, name);
  MemoryStream stream(bytes, name);
  Imf::Header claims;
  int version = 0;
  stream.seekg(8);
  std::memcpy(&version, bytes.data() + 4, sizeof version);
  claims.readFrom(stream, version);
  check_claims(claims, bytes.size(), name);

  stream.seekg(0);
  Imf::InputFile file(stream);
  if (!file.isComplete()) throw damaged(name, "it was cut short");
  const Imath::Box2i window = file.header().dataWindow();
  Image image;
  image.width = window.max.x - window.min.x + 1;
  image.height = window.max.y - window.min.y + 1;
  const Imf::Header standard;  // its entries are OpenEXR's own
  for (auto it = file.header().begin(); it != file.header().end(); ++it) {
    if (standard.find(it.name()) != standard.end()) continue;
    if (const auto attribute = from_exr(it.attribute())) image.attributes[it.name()] = *attribute;
  }
  Imf::FrameBuffer buffer;
  const Imf::ChannelList& channels = file.header().channels();
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    std::vector<float>& plane = image.channels[it.name()];
    plane.resize(static_cast<size_t>(image.width) * static_cast<size_t>(image.height));
    buffer.insert(it.name(), slice(plane, image.width, window.min));
  }
  file.setFrameBuffer(buffer);
  file.readPixels(window.min.y, window.max.y);
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
  return decode_exr(read_file(path, "image", kMaxFileBytes), path.string());
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
