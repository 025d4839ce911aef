// How noisy each pixel of a render is, so that noise can be added to just what is missing.
#pragma once

#include <torch/types.h>

#include "client/dataset/dataset.h"

namespace itn {

// The noise of a square image of `side` pixels brought to `resolution` pixels, by averaging if they
// are fewer: 1 x resolution x resolution, the relative noise of each pixel of the object (standard
// deviation over radiance; infinite if it is nothing but noise), 0 beside it.
//
// Radiance and noise are root mean squares under a Gaussian of 1.5 pixels: the standard error of
// one pixel, from some tens of samples, is uncertain, and large where the radiance happens to be.
// An image's noise as a whole (relative_noise()) would not do: of a medium that scatters forwards
// the rim is bright and the inside twice as noisy, relative to itself, as the image. Filled up to
// the same level everywhere by one number for all pixels, the inside stays noisier, and a network
// that is trained for long enough reads g from that. In a dataset of a grid of materials those of
// lower albedos, which come of the same paths, have less noise than their files say (itn dataset
// --grid).
torch::Tensor noise_map(const DatasetImage& image, int side, int resolution);

}  // namespace itn
