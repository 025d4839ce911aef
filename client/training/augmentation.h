// What is done to the images of a batch, afresh in each step, before the network sees them.
#pragma once

#include <cstdint>

#include "common/learning/network_input.h"

namespace itn {

// Brings the relative noise of every image up to `noise` (standard deviation over radiance of a
// pixel) by adding what is missing. At a fixed number of samples the noise of a render tells its
// material; noise that is the same in all images tells nothing. Images that are noisier stay as
// they are. Luminance stays >= 0. A function of its arguments alone.
ImageBatch with_noise(ImageBatch images, double noise, uint64_t seed);

}  // namespace itn
