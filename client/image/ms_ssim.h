// How alike two images look.
#pragma once

#include <span>

namespace itn {

// The multi-scale structural similarity of Wang, Simoncelli, Bovik, "Multiscale structural
// similarity for image quality assessment" (Asilomar 2003): 1 for equal images, less the less
// alike they look, 0 at worst. At each scale, statistics under a Gaussian window of 11 pixels and
// standard deviation 1.5, wherever it fits:
//
//   l = (2 mu_x mu_y + C1) / (mu_x^2 + mu_y^2 + C1),  C1 = (0.01 L)^2
//   cs = (2 sigma_xy + C2) / (sigma_x^2 + sigma_y^2 + C2),  C2 = (0.03 L)^2
//   MS-SSIM = mean(l cs of the last scale)^w_M prod_{j<M} mean(cs_j)^w_j
//
// with w = .0448, .2856, .3001, .2363, .1333, each scale the 2 x 2 means of the one before, a mean
// below 0 counted as 0. The paper's five scales need 176 pixels a side. Of a smaller image there
// are as many as the window fits into (128: four, 64: three), the weights over their sum.
//
// L, the range of the values, is the largest of the reference: radiance has no other. Both images:
// side x side, top row first, finite. Throws Error (invalid input) if they differ in size, the
// window does not fit, or the reference has no value above 0.
double ms_ssim(int side, std::span<const float> reference, std::span<const float> image);

}  // namespace itn
