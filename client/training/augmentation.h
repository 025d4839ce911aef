// Other images of the same truth, so that a network sees each photograph in many ways and learns
// nothing from how noisy it is.
#pragma once

#include <cstdint>

#include "common/learning/network_input.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// Throws Error (invalid input) that names the field.
void validate(const v1::Augmentation& augmentation);

// Each image mirrored, shifted, seen through a camera (camera_augmentation.h), made brighter or
// darker, of another white balance and noisier, as `augmentation` says; noise must be defined. A
// function of its arguments
// alone. The result may share storage with the input, which stays as it is.
//
// Noise is added last: to the luminance of each pixel a normal number times the luminance, so that
// the image's relative noise becomes a level that is drawn without regard to the material. Renders
// of a fixed number of samples have a noise that tells the material: from images of one level a
// network cannot learn it. An image that is noisier than the level stays as it is.
ImageBatch augmented(const ImageBatch& images, const v1::Augmentation& augmentation, uint64_t seed);

// Noise alone, and the same level for all; 0: none.
v1::Augmentation noise_of_level(double level);
ImageBatch with_noise(const ImageBatch& images, double level, uint64_t seed);

}  // namespace itn
