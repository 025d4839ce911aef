#include "client/image/tiff_directory.h"

#include <bit>
#include <cmath>

namespace itn {
namespace {

constexpr size_t kEntryBytes = 12;

// An unsigned integer of 1, 2 or 4 bytes, which lie within the file.
uint32_t integer(std::string_view file, size_t at, size_t bytes, bool little_endian) {
  uint32_t value = 0;
  for (size_t i = 0; i < bytes; ++i) {
    const size_t from = at + (little_endian ? bytes - 1 - i : i);
    value = value << 8U | static_cast<unsigned char>(file[from]);
  }
  return value;
}

// The bytes of the types of numbers; 0 for others.
size_t bytes_of_type(uint32_t type) {
  switch (type) {
    case 1:  // BYTE
      return 1;
    case 3:  // SHORT
      return 2;
    case 4:   // LONG
    case 9:   // SLONG
    case 11:  // FLOAT
    case 13:  // IFD
      return 4;
    case 5:   // RATIONAL
    case 10:  // SRATIONAL
      return 8;
    default: return 0;
  }
}

double value_of_type(std::string_view file, size_t begin, uint32_t type, bool little_endian) {
  const size_t bytes = bytes_of_type(type);
  const auto part = [&](size_t offset) { return integer(file, begin + offset, 4, little_endian); };
  switch (type) {
    case 5: return static_cast<double>(part(0)) / part(4);
    case 9: return static_cast<int32_t>(part(0));
    case 10:
      return static_cast<double>(static_cast<int32_t>(part(0))) / static_cast<int32_t>(part(4));
    case 11: return std::bit_cast<float>(part(0));
    default: return integer(file, begin, bytes, little_endian);
  }
}

std::optional<double> if_positive(std::optional<double> value) {
  return value && std::isfinite(*value) && *value > 0 ? value : std::nullopt;
}

}  // namespace

std::optional<TiffDirectory> TiffDirectory::first(std::string_view file) {
  if (file.size() < 8) return std::nullopt;
  const bool little_endian = file.starts_with("II");
  if (!little_endian && !file.starts_with("MM")) return std::nullopt;
  return read_at(file, little_endian, integer(file, 4, 4, little_endian));
}

std::optional<TiffDirectory> TiffDirectory::read_at(std::string_view file, bool little_endian,
                                                    size_t offset) {
  if (file.size() < 2 || offset > file.size() - 2) return std::nullopt;
  const size_t count = integer(file, offset, 2, little_endian);
  if (count * kEntryBytes > file.size() - offset - 2) return std::nullopt;
  return TiffDirectory(file, little_endian, offset + 2, count);
}

std::optional<TiffDirectory> TiffDirectory::next() const {
  const size_t end = entries_ + count_ * kEntryBytes;
  if (end > file_.size() || file_.size() - end < 4) return std::nullopt;
  const uint32_t offset = integer(file_, end, 4, little_endian_);
  return offset == 0 ? std::nullopt : read_at(file_, little_endian_, offset);
}

std::optional<double> TiffDirectory::number(uint16_t tag, size_t index) const {
  for (size_t i = 0; i < count_; ++i) {
    const size_t entry = entries_ + i * kEntryBytes;
    if (integer(file_, entry, 2, little_endian_) != tag) continue;
    const uint32_t type = integer(file_, entry + 2, 2, little_endian_);
    const uint32_t count = integer(file_, entry + 4, 4, little_endian_);
    const size_t bytes = bytes_of_type(type);
    if (bytes == 0 || index >= count) return std::nullopt;
    // What fits into four bytes is in the entry itself.
    const size_t values =
        bytes * count <= 4 ? entry + 8 : integer(file_, entry + 8, 4, little_endian_);
    const size_t value = values + index * bytes;
    if (value > file_.size() || file_.size() - value < bytes) return std::nullopt;
    return value_of_type(file_, value, type, little_endian_);
  }
  return std::nullopt;
}

std::optional<TiffDirectory> TiffDirectory::directory(uint16_t tag) const {
  const auto offset = number(tag);
  if (!offset || !(*offset >= 0 && *offset <= UINT32_MAX)) return std::nullopt;
  return read_at(file_, little_endian_, static_cast<size_t>(*offset));
}

// The numbers of the tags: Exif 2.3 (CIPA DC-008), section 4.6.
Exif read_exif(const TiffDirectory& first) {
  Exif exif;
  if (const auto orientation = first.number(274); orientation >= 1 && orientation <= 8) {
    exif.orientation = static_cast<int>(*orientation);
  }
  const TiffDirectory taken = first.directory(34665).value_or(first);
  exif.exposure_seconds = if_positive(taken.number(33434));
  exif.f_number = if_positive(taken.number(33437));
  exif.focal_length_35mm = if_positive(taken.number(41989));
  exif.iso = if_positive(taken.number(34855));
  if (exif.iso == 65535) exif.iso.reset();  // "see another tag"
  exif.is_srgb = taken.number(40961).value_or(1) == 1;
  return exif;
}

}  // namespace itn
