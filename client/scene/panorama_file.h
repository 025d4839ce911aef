// Files of panoramas and other images in scenes.
#pragma once

#include <filesystem>

#include "itn/v1/scene.pb.h"

namespace itn {

// An OpenEXR file with channels R, G, B or Y (radiance_channels() says which are meant), or a
// Radiance HDR file; with a warning where it is not twice as wide as high. What is a little below
// 0, a hundredth of the largest value, becomes 0, with a warning. Throws Error: as read_exr(),
// decode_hdr() and radiance_channels(), with the file's name; kInvalidInput if it has other
// primaries than sRGB's, or is of another format.
v1::Pixels load_panorama(const std::filesystem::path& path);

// The same of an OpenEXR or a PNG file; the numbers of the latter are taken through the sRGB curve.
// Throws Error: kIo, kDataLoss (damaged), kInvalidInput (another kind of file).
v1::Pixels load_reflectances(const std::filesystem::path& path);

}  // namespace itn
