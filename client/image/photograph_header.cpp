#include "client/image/photograph_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>

#include "common/error.h"

namespace itn {
namespace {

using namespace std::string_view_literals;

// Deflate makes data 1032 times smaller at most, JPEG 1024 times. What compresses better is
// constant, and accepted where it is small.
constexpr int64_t kMaxCompression = 1032;
constexpr int64_t kAlwaysAcceptedBytes = int64_t{64} << 20;

constexpr const char* kWhatIsRead =
    "a photograph is an OpenEXR, PNG, JPEG, TIFF, Radiance HDR, HEIC or WebP image";

// A file, and where it is wrong.
struct File {
  std::string_view bytes;
  std::string name;
  RecognizedFormat recognized;

  Error damaged(const std::string& reason) const {
    return {ErrorKind::kDataLoss, fmt::format("{} begins as {} and is not a complete one: {}", name,
                                              recognized.name, reason)};
  }
  Error cut_short() const { return damaged("it was cut short"); }
  Error unsupported(const std::string& what, const std::string& right) const {
    return invalid_input(
        fmt::format("{} is {} {}, which is not read; {}", name, recognized.name, what, right));
  }

  std::string_view part(size_t offset, size_t size) const {
    if (offset > bytes.size() || size > bytes.size() - offset) throw cut_short();
    return bytes.substr(offset, size);
  }
  uint32_t byte(size_t offset) const { return static_cast<unsigned char>(part(offset, 1)[0]); }
  uint32_t big_endian(size_t offset, size_t size) const {
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) value = value << 8U | byte(offset + i);
    return value;
  }
  uint32_t little_endian(size_t offset, size_t size) const {
    uint32_t value = 0;
    for (size_t i = size; i-- > 0;) value = value << 8U | byte(offset + i);
    return value;
  }
};

Exif exif_of(std::string_view tiff) {
  const auto directory = TiffDirectory::first(tiff);
  return directory ? read_exif(*directory) : Exif{};
}

// --- PNG (ISO/IEC 15948): chunks of length, type, data, checksum ---

PhotographHeader png_header(const File& file) {
  if (file.part(12, 4) != "IHDR") throw file.damaged("it does not begin with its header");
  PhotographHeader header{.width = file.big_endian(16, 4), .height = file.big_endian(20, 4)};
  header.bytes_per_pixel = file.byte(24) == 16 ? 8 : 4;  // at most: of RGBA
  for (size_t offset = 8; offset + 8 < file.bytes.size();) {
    const uint32_t size = file.big_endian(offset, 4);
    const std::string_view type = file.part(offset + 4, 4);
    if (type == "eXIf") header.exif = exif_of(file.part(offset + 8, size));
    if (type == "cICP" && size >= 4) {
      if (file.byte(offset + 11) != 1) {
        throw file.unsupported("of narrow range (cICP)", "save it with the full range of values");
      }
      header.code_points = std::pair(static_cast<int>(file.byte(offset + 8)),
                                     static_cast<int>(file.byte(offset + 9)));
    }
    if (type == "acTL") throw file.unsupported("of several frames", "save one of them");
    offset += size_t{12} + size;
  }
  return header;
}

// --- JPEG (ITU-T T.81, annex B): segments of marker, length, data ---

bool is_start_of_frame(uint32_t marker) {
  return marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
}

void read_frame(const File& file, uint32_t marker, size_t offset, PhotographHeader& header) {
  const bool sequential_or_progressive = marker <= 0xc2 || marker == 0xc9 || marker == 0xca;
  if (!sequential_or_progressive || file.byte(offset) != 8) {
    throw file.unsupported("without loss or of more than 8 bits", "save it as PNG or TIFF");
  }
  header.height = file.big_endian(offset + 1, 2);
  header.width = file.big_endian(offset + 3, 2);
  header.bytes_per_pixel = file.byte(offset + 5);
  if (header.bytes_per_pixel == 4) throw file.unsupported("of CMYK", "save it as RGB");
}

PhotographHeader jpeg_header(const File& file) {
  PhotographHeader header;
  for (size_t offset = 2;;) {
    if (file.byte(offset) != 0xff) throw file.damaged("a segment does not begin where it should");
    while (file.byte(offset) == 0xff) ++offset;
    const uint32_t marker = file.byte(offset++);
    if (marker == 0xda || marker == 0xd9) throw file.damaged("it has no frame");
    const uint32_t size = file.big_endian(offset, 2);
    if (size < 2) throw file.damaged("a segment has no length");
    const std::string_view data = file.part(offset + 2, size - 2);
    if (marker == 0xe1 && data.starts_with("Exif\0\0"sv)) header.exif = exif_of(data.substr(6));
    if (is_start_of_frame(marker)) {
      read_frame(file, marker, offset + 2, header);
      return header;
    }
    offset += size;
  }
}

// --- TIFF 6.0 ---

// Without those that are the first one again, only smaller. A chain that leads back ends.
int pages_from(const TiffDirectory& first) {
  constexpr int kMost = 1000;
  int pages = 1;
  std::optional<TiffDirectory> directory = first.next();
  for (int links = 0; directory && links < kMost; ++links, directory = directory->next()) {
    const bool is_reduced = (static_cast<int64_t>(directory->number(254).value_or(0)) & 1) != 0;
    if (!is_reduced) ++pages;
  }
  return pages;
}

PhotographHeader tiff_header(const File& file) {
  const auto directory = TiffDirectory::first(file.bytes);
  if (!directory) throw file.cut_short();
  const auto tag = [&](uint16_t number, int64_t otherwise) {
    const double value = directory->number(number).value_or(static_cast<double>(otherwise));
    if (!(value >= 0 && value <= UINT32_MAX)) {
      throw file.damaged(fmt::format("its tag {} is {}", number, value));
    }
    return static_cast<int64_t>(value);
  };
  const bool is_thumbnail = (tag(254, 0) & 1) != 0;
  const int64_t photometric = tag(262, 1);
  if (is_thumbnail) {
    throw file.unsupported("whose first image is a thumbnail, as in a camera's raw data",
                           "save the image alone, or develop the raw data");
  }
  if (directory->number(50706) || photometric > 30000) {
    throw file.unsupported("of a camera's raw data",
                           "develop it, linear if you can, to 16-bit TIFF");
  }
  if (photometric == 5) throw file.unsupported("of CMYK", "save it as RGB");
  if (photometric > 6) throw file.unsupported("of another colour space", "save it as RGB");
  const int64_t samples = tag(277, 1);
  if (samples < 1 || samples > 64) {
    throw file.damaged(fmt::format("its header claims {} channels", samples));
  }
  const int64_t bits = tag(258, 1);
  PhotographHeader header{.width = tag(256, 0),
                          .height = tag(257, 0),
                          .exif = read_exif(*directory),
                          .pages = pages_from(*directory)};
  const int64_t value_bytes = bits > 32 ? 8 : bits > 16 ? 4 : bits > 8 ? 2 : 1;
  header.bytes_per_pixel = std::max<int64_t>(samples, photometric == 3 ? 3 : 1) * value_bytes;
  if (tag(322, 1) > kMaxPhotographSide || tag(323, 1) > kMaxPhotographSide) {
    throw file.damaged("its header claims tiles larger than any image");
  }
  return header;
}

// --- WebP (RFC 9649): chunks of type, length, data, of an even number of bytes ---

PhotographHeader webp_header(const File& file) {
  if (size_t{8} + file.little_endian(4, 4) > file.bytes.size()) throw file.cut_short();
  PhotographHeader header{.bytes_per_pixel = 4};
  bool has_alpha = false;
  for (size_t offset = 12; offset + 8 <= file.bytes.size();) {
    const std::string_view type = file.part(offset, 4);
    const uint32_t size = file.little_endian(offset + 4, 4);
    const size_t data = offset + 8;
    if (type == "VP8 ") {
      header.width = file.little_endian(data + 6, 2) & 0x3fffU;
      header.height = file.little_endian(data + 8, 2) & 0x3fffU;
    } else if (type == "VP8L") {
      const uint32_t bits = file.little_endian(data + 1, 4);
      header.width = (bits & 0x3fffU) + 1;
      header.height = (bits >> 14U & 0x3fffU) + 1;
      has_alpha = has_alpha || (bits >> 28U & 1U) != 0;
    } else if (type == "ALPH") {
      has_alpha = true;
    } else if (type == "ANIM") {
      throw file.unsupported("of several frames", "save one of them");
    } else if (type == "ICCP") {
      header.profile = file.part(data, size);
    } else if (type == "EXIF") {
      std::string_view exif = file.part(data, size);
      if (exif.starts_with("Exif\0\0"sv)) exif.remove_prefix(6);
      header.exif = exif_of(exif);
    }
    offset = data + size + size % 2;
  }
  // Its colours would come multiplied by alpha, and rounded to 8 bits.
  if (has_alpha) throw file.unsupported("with alpha", "save it as PNG");
  return header;
}

// --- HEIF (ISO/IEC 23008-12): "ispe" boxes have the sizes of the image and of its parts ---

PhotographHeader heif_header(const File& file) {
  PhotographHeader header{.bytes_per_pixel = 4};
  // Type (4 bytes), version and flags (4), width (4), height (4).
  for (size_t offset = file.bytes.find("ispe"); offset != std::string_view::npos;
       offset = file.bytes.find("ispe", offset + 4)) {
    if (file.bytes.size() - offset < 16) break;
    if (file.big_endian(offset - 4, 4) != 20) continue;  // these letters by chance
    header.width = std::max<int64_t>(header.width, file.big_endian(offset + 8, 4));
    header.height = std::max<int64_t>(header.height, file.big_endian(offset + 12, 4));
  }
  return header;
}

PhotographHeader header_of(const File& file) {
  switch (file.recognized.format) {
    case ImageFormat::kPng: return png_header(file);
    case ImageFormat::kJpeg: return jpeg_header(file);
    case ImageFormat::kTiff: return tiff_header(file);
    case ImageFormat::kWebp: return webp_header(file);
    case ImageFormat::kHeif: return heif_header(file);
    default: break;
  }
  throw invalid_input(fmt::format("{} is {}; {}", file.name, file.recognized.name, kWhatIsRead));
}

// By its beginning.
bool is_text(std::string_view bytes) {
  return std::ranges::none_of(bytes.substr(0, 512), [](char c) {
    return (c >= 0 && c < ' ' && c != '\n' && c != '\r' && c != '\t') || c == '\x7f';
  });
}

void check_claims(const PhotographHeader& header, const File& file) {
  if (header.width < 1 || header.height < 1) throw file.damaged("its header claims no pixels");
  if (header.width > kMaxPhotographSide || header.height > kMaxPhotographSide) {
    throw invalid_input(fmt::format("{} has {} x {} pixels; at most {} x {} are accepted",
                                    file.name, header.width, header.height, kMaxPhotographSide,
                                    kMaxPhotographSide));
  }
  const int64_t claimed = header.width * header.height * header.bytes_per_pixel;
  const auto size = static_cast<int64_t>(file.bytes.size());
  if (claimed > std::max(kAlwaysAcceptedBytes, kMaxCompression * size)) {
    throw file.damaged(fmt::format("its header claims {} x {} pixels, the file has {} bytes",
                                   header.width, header.height, size));
  }
}

}  // namespace

PhotographHeader read_photograph_header(std::string_view bytes, const std::string& name) {
  const File file{bytes, name, recognize_format(bytes)};
  if (bytes.empty()) throw Error(ErrorKind::kDataLoss, fmt::format("{} is empty", name));
  if (file.recognized.format == ImageFormat::kUnknown) {
    if (is_text(bytes)) throw invalid_input(fmt::format("{} is text; {}", name, kWhatIsRead));
    throw Error(ErrorKind::kDataLoss,
                fmt::format("{} does not begin as any image that is read; {}", name, kWhatIsRead));
  }
  PhotographHeader header = header_of(file);
  check_claims(header, file);
  header.format = file.recognized.format;
  header.format_name = file.recognized.name;
  return header;
}

}  // namespace itn
