// The images of mottled grounds.
#pragma once

#include "itn/v1/dataset.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// A side of the image, in pixels: of the finest octave of its noise, a cell has two.
inline constexpr uint32_t kTexturePixels = 128;

// Noise that goes on beyond each side as it begins on the other: the sum of octaves of random
// numbers on a lattice, between which it is smooth, stretched until it reaches from one reflectance
// to the other. GroundChoice in dataset.proto says what the numbers mean. The same numbers give the
// same bits.
v1::Pixels mottled(const v1::GroundTexture& texture);

}  // namespace itn
