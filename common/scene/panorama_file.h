// Files of panoramas and other images in scenes.
#pragma once

#include <filesystem>

#include "itn/v1/scene.pb.h"

namespace itn {

// An OpenEXR file with channels R, G, B or Y (radiance_channels() says which are meant). That they
// are not negative is checked where the scene is built. Throws Error: as read_exr() and
// radiance_channels(), with the file's name.
v1::Pixels load_panorama(const std::filesystem::path& path);

// The same of an OpenEXR or a PNG file; the numbers of the latter are taken through the sRGB curve.
// Throws Error: kIo, kDataLoss (damaged), kInvalidInput (another kind of file).
v1::Pixels load_reflectances(const std::filesystem::path& path);

}  // namespace itn
