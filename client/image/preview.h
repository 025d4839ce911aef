// Linear radiance as people see it on a screen.
#pragma once

#include <vector>

namespace itn {

// The radiance that a picture shows as white: its 99th percentile, or 1 where that is not above 0.
// `values` is not empty.
float white_level(std::vector<float> values);

// From [0, 1] to [0, 255]; beyond, the nearest end.
unsigned char to_byte(float value);

// The byte of a linear value in sRGB (IEC 61966-2-1).
unsigned char to_srgb_byte(float linear);

}  // namespace itn
