// Images of float channels, read and written as OpenEXR; written as PNG for people to look at.
#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace itn {

// Named planes of one size, with text attributes that travel in the file's header.
// Names of ours: "Y" radiance (or "R", "G", "B"), "sigma_t.Y", "albedo.Y", "g.Y" derivatives,
// "mask.Y", "stderr.Y".
struct Image {
  int width = 0;
  int height = 0;
  std::map<std::string, std::vector<float>> channels;  // each width * height, top row first
  std::map<std::string, std::string> attributes;

  bool has(const std::string& channel) const { return channels.contains(channel); }
  // Throws Error (invalid input) that names the channels that there are.
  const std::vector<float>& channel(const std::string& name) const;
};

// Throws Error: kIo (cannot be opened), kDataLoss (not an EXR, or cut short), kInvalidInput (NaN or
// infinite values, with channel and pixel; more than 2^28 pixels).
Image read_exr(const std::filesystem::path& path);

// 32-bit float, ZIP-compressed. Written to a temporary name beside `path` and renamed. Throws Error
// (kIo).
void write_exr(const std::filesystem::path& path, const Image& image);

// 8-bit RGB, 3 bytes a pixel, top row first. Written to a temporary name and renamed. Throws Error
// (kIo).
void write_png(const std::filesystem::path& path, int width, int height,
               std::span<const unsigned char> rgb);

}  // namespace itn
