// How noisy an image is, and how many samples make it so noisy.
#pragma once

#include <cstdint>
#include <span>

#include "itn/v1/dataset.pb.h"

namespace itn {

// The noise that NoiseTarget defines, from the radiance, its standard error and the mask of the
// object; all of a size. 0 of a black image, and where no noise is known, as with a single sample;
// infinite of one that is nothing but noise. An upper bound, as the standard error is.
//
// It is that of the image as a whole, in which bright pixels weigh most. Relative to themselves
// dark ones are noisier: at a large g, which makes the rim bright, those inside by up to twice.
// noise_map() (client/training/noise_map.h) has the noise of each pixel.
double relative_noise(std::span<const float> radiance, std::span<const float> standard_error,
                      std::span<const float> mask);

// Samples per pixel that bring the noise down to the target, by that of the pilot.
uint32_t spp_for(const v1::NoiseTarget& target, double pilot_noise);

}  // namespace itn
