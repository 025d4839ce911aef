// Weights of where in an image the material shows most: near edges.
#pragma once

#include <span>
#include <vector>

namespace itn {

// w(p) = mask(p) * max(0, 1 - d(p) / D), in [0, 1]
//
// d(p) is the distance in pixels from p to the nearest edge, D a quarter of the longer image side.
// Edges are those of the Canny detector on the blurred square root of the image (within the mask),
// and the silhouette of the mask. Near edges (thin parts, silhouettes, shadow borders) media that
// are similar in the sense of similarity theory look different; elsewhere they look alike
// (Che et al. 2020, Sec. 4.2).
//
// `luminance` and `mask`: width * height, top row first; luminance finite and >= 0, mask in [0, 1].
// The scale of the luminance does not matter. A mask without a pixel above 0.5 gives all zeros.
std::vector<float> weight_map(int width, int height, std::span<const float> luminance,
                              std::span<const float> mask);

}  // namespace itn
