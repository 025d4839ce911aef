// What a network is shown of an image: named planes, computed for a batch of images by the same
// code in training and prediction.
#pragma once

#include <span>
#include <vector>

#include <torch/types.h>

#include "itn/v1/learning.pb.h"

namespace itn {

// Square images of one size, as they were measured: planes x resolution x resolution, float, where
// an image in colour has three planes, red, green and blue, and any other has one.
struct ImageBatch {
  torch::Tensor luminance;  // >= 0, unscaled; in colour the radiance of each
  torch::Tensor mask;       // in [0, 1], 1 on the object
  torch::Tensor weight;     // weight_map() of each; undefined unless needs_weight_map()
  torch::Tensor noise;      // relative, of each pixel: standard deviation over radiance; undefined
                            // where nobody knows
  int64_t channels = 1;     // planes of an image

  int64_t planes() const { return luminance.size(0); }
  int64_t size() const { return planes() / channels; }
};

// Luminance, mask and, if they are defined, weight map and noise. They share storage with the
// images.
std::vector<torch::Tensor> planes_of(const ImageBatch& images);

// Whether the model's input has the weight map among its planes.
bool needs_weight_map(v1::NetworkInput input);

// Planes of the model's input. Throws Error (invalid input) if it is not one that is known.
int64_t input_channels(const v1::Model& model);

// images x input_channels x resolution x resolution, float, 0 outside of the objects.
//
// LUMINANCE_AND_WEIGHT: image_scale * luminance * mask, and the weight map.
//
// RATIOS, of y = image_scale * luminance, or luminance over its mean over the object if the
// exposure is unknown:
//   0  ln(y + 0.01)
//   1  4 (y / local mean - 1), the local mean over the object's pixels nearby, under a Gaussian of
//      1/32 of the side (2 pixels of 64): what blurs away, free of shading and exposure
//   2  y / mean over the object - 1: shading, free of exposure
//   3  mask
// where ratios end at 10, planes 0 to 2 are multiplied by the mask. In colour planes 0 to 2 of each
// colour, then the mask; an unknown exposure is one of all colours, whose mean over the object is
// divided by.
torch::Tensor network_input(const v1::Model& model, const ImageBatch& images);

// A square image and its mask brought to another size, as luminance and mask of a batch of one:
// averages over areas where the image shrinks, interpolates where it grows. Means of luminance are
// weighted by the mask, so that nothing of the background gets into the object. Adds the weight map
// if the input needs it.
ImageBatch resampled(int side, std::span<const float> luminance, std::span<const float> mask,
                     int resolution, v1::NetworkInput input);

// Noise added to images: to the luminance of each pixel `normal`, a standard normal number, times
// the luminance, so that its relative noise becomes `level` (by plane). A pixel that is noisier
// already stays as it is. To images whose noise nobody knows all of it is added. `normal`: planes
// or 1 x resolution x resolution.
ImageBatch brought_up_to_noise(const ImageBatch& images, const torch::Tensor& level,
                               const torch::Tensor& normal);

// Numbers of images, given to each of their planes.
torch::Tensor for_planes(const torch::Tensor& of_images, int64_t channels);

// The mean of each image over its object, in colour of all colours together: planes x 1 x 1.
torch::Tensor mean_on_object(const ImageBatch& images);

// Images of one plane each, the luminance of those in colour.
ImageBatch luminance_of(const ImageBatch& images);

// One of the images, as a batch of one that shares their storage.
ImageBatch image_of(const ImageBatch& images, int64_t index);

// Each image with left and right exchanged.
ImageBatch mirrored(const ImageBatch& images);

// All images in one batch. Requires one at least; noise is dropped unless all have it.
ImageBatch concatenated(std::span<const ImageBatch> batches);

}  // namespace itn
