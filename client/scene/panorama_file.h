// Image files that scenes refer to: panoramas, and reflectances of surfaces.
#pragma once

#include <filesystem>

#include "itn/v1/scene.pb.h"

namespace itn {

// Loads an OpenEXR file with channels R, G, B or Y (radiance_channels() says which are meant), or a
// Radiance HDR file. It warns of an image that is not twice as wide as high, and of values a little
// below 0, within a hundredth of the largest, which become 0. Throws Error: as read_exr(),
// decode_hdr() and radiance_channels(), with the file's name; kInvalidInput if it has other
// primaries than sRGB's, or is of another format.
v1::Pixels load_panorama(const std::filesystem::path& path);

// Loads reflectances: an OpenEXR file as it is, or a PNG file, which is decoded from sRGB. Throws
// Error: kIo, kDataLoss (damaged), kInvalidInput (another kind of file).
v1::Pixels load_reflectances(const std::filesystem::path& path);

}  // namespace itn
