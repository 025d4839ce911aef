// Photographs as files. Apart from whatever needs messages: headers of OpenImageIO and of protobuf
// cannot be read together.
#pragma once

#include <span>
#include <string>

namespace itn {

// JPEG of quality 80, its colours at half the resolution; the others as OpenImageIO writes them.
enum class Encoding { kPng, kJpeg, kTiff, kHdr, kWebp, kHeic };

// 8-bit RGB, 3 bytes a pixel, top row first.
std::string encoded(int width, int height, std::span<const unsigned char> rgb, Encoding encoding);

}  // namespace itn
