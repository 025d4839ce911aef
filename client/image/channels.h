// Which channels of an image are meant, whatever program wrote it.
#pragma once

#include <string>
#include <vector>

#include "client/image/image.h"

namespace itn {

// The names of the channels that hold radiance: red, green and blue, or a single one. Looked for in
// this order: R, G, B; Y or L; the same in the only layer that has them ("env.R", ...), or in the
// one that Blender calls Combined; the only channel that there is, beside alpha and mask. Y beside
// X and Z is a coordinate. `wanted_layer`, unless empty: that one ("ViewLayer.DiffDir"). Throws
// Error (invalid input) that names the channels found and wanted, and where several layers could be
// meant, the recovery hint; `name` is the file's.
std::vector<std::string> radiance_channels(
    const Image& image, const std::string& name, const std::string& wanted_layer = "",
    const std::string& recovery_hint = "save that which is meant by itself");

// "ViewLayer.Combined.A" beside "ViewLayer.Combined.R", "A" beside "R".
std::string alpha_beside(const std::string& channel);

// The channel of a mask file: mask.Y, mask, Y, L, R, A, or the only one. Throws likewise.
std::string mask_channel(const Image& image, const std::string& name);

}  // namespace itn
