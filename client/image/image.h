// Images of float channels, read and written as OpenEXR; written as PNG for people to look at.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace itn {

// An entry of a file's header. The names of ours: client/image/attributes.h.
using Attribute = std::variant<std::string, int, double>;

// Named planes of one size, with attributes that travel in the file's header.
// Names of ours: "Y" radiance (or "R", "G", "B"), "sigma_t.Y", "albedo.Y", "g.Y" derivatives,
// "mask.Y", "stderr.Y".
struct Image {
  int width = 0;
  int height = 0;
  std::map<std::string, std::vector<float>> channels;  // each width * height, top row first
  std::map<std::string, Attribute> attributes;

  bool has(const std::string& channel) const { return channels.contains(channel); }
  std::string channel_names() const;  // for messages: "B, G, R"
  // Throws Error (invalid input) that names the channels that there are.
  const std::vector<float>& channel(const std::string& name) const;
};

// Throws Error (invalid input) that names the first value that is NaN or infinite by its channel
// and pixel; `name` is the file's.
void check_finite(const Image& image, const std::string& name);

// Files of images have at most so many bytes: 2^30 uncompressed values, and a header.
constexpr uint64_t kMaxImageFileBytes = (uint64_t{1} << 32) + (uint64_t{1} << 24);

// An OpenEXR file, in scan lines or tiles (of these the full resolution): its display window, black
// where it has no pixels. Of several parts, the first one's channels have their own names, those of
// others of its size the name of their part and a dot before it. Nothing is allocated that the file
// is too small to fill. Header entries other than text, integers and floating-point numbers are
// left out, but for attribute::kChromaticities. Throws Error: kIo (cannot be read, not a regular
// file), kDataLoss (not an EXR, cut short, claims more than it can hold), kInvalidInput (deep data;
// a subsampled channel; more than 2^28 pixels or 2^30 values; NaN or infinite values, with channel
// and pixel).
Image read_exr(const std::filesystem::path& path);
// Decodes such a file in memory; `name` is for messages.
Image decode_exr(std::string_view bytes, const std::string& name);

// A Radiance HDR file in memory: R, G and B, upright, of radiance before its exposure and
// correction of colours. `name` is for messages. Throws Error: kDataLoss (no such file, damaged,
// cut short, claims more than it can hold), kInvalidInput (of XYZ; more than 16384 pixels a side).
Image decode_hdr(std::string_view bytes, const std::string& name);

// 32-bit float, ZIP-compressed; the target is written as by write_file_atomically(), whose errors
// it throws.
void write_exr(const std::filesystem::path& path, const Image& image);

// 8-bit sRGB, 3 bytes a pixel, or 4 with an alpha by which colours are not multiplied; top row
// first: the bytes of a PNG file.
std::string encode_png(int width, int height, std::span<const unsigned char> rgb);

// Writes such bytes as write_exr() does its own.
void write_png(const std::filesystem::path& path, int width, int height,
               std::span<const unsigned char> rgb);

}  // namespace itn
