// Directories of tags, as they are in TIFF files and, by the name of EXIF, in the files of cameras.
// Source: TIFF 6.0 (Adobe, 1992), section 2.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace itn {

// Reads bytes of a stranger: nothing outside of them is read. They must outlive it.
class TiffDirectory {
 public:
  // The first directory of a file; none if it does not lie within the bytes.
  static std::optional<TiffDirectory> first(std::string_view file);

  // The one that the file has behind this one; none if there is none.
  std::optional<TiffDirectory> next() const;

  // Value `index` of a tag, whatever type of number it has; none if there is no such number.
  std::optional<double> number(uint16_t tag, size_t index = 0) const;
  // The directory that a tag leads to.
  std::optional<TiffDirectory> directory(uint16_t tag) const;

 private:
  TiffDirectory(std::string_view file, bool little_endian, size_t entries, size_t count)
      : file_(file), little_endian_(little_endian), entries_(entries), count_(count) {}

  static std::optional<TiffDirectory> read_at(std::string_view file, bool little_endian,
                                              size_t offset);

  std::string_view file_;
  bool little_endian_;
  size_t entries_;  // where they begin
  size_t count_;
};

// What the camera says of how the photograph was taken, where it says so, and it can be.
struct Exif {
  int orientation = 1;  // 1 to 8, as in TIFF: 1 has the first row on top
  std::optional<double> exposure_seconds{}, f_number{}, iso{};
  std::optional<double> focal_length_35mm{};
  bool is_srgb = true;  // false: the colours are said to be of another space
};

Exif read_exif(const TiffDirectory& first);

}  // namespace itn
