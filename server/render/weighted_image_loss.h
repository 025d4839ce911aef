// The loss of a render against an image and its gradient, from independent estimates: the image
// term of inverse transport networks.
#pragma once

#include <span>
#include <vector>

#include "common/render_estimate.h"

namespace itn {

// Che et al., ICCP 2020, Eq. 10, over the input's weighted energy, so that it is a relative squared
// error that does not depend on exposure or on how large the object is:
//
//   L = sum_p w_p^2 (I_p - T_p)^2 / sum_p w_p^2 I_p^2
//   dL/dpi = 2 sum_p w_p^2 (T_p - I_p) dT_p/dpi / sum_p w_p^2 I_p^2
//
// The renders are noisy. A product of two quantities estimated from the same samples is biased by
// their covariance; a product of independent ones is not. So every product is averaged over the
// pairs of different estimates (a U-statistic): with K estimates T_k and D_k of dT/dpi,
//
//   (T - I)^2     ~  [(sum_k (T_k - I))^2 - sum_k (T_k - I)^2] / K (K - 1)
//   (T - I) dT    ~  [(sum T_k) (sum D_k) - sum T_k D_k - (K - 1) I sum D_k] / K (K - 1).
//
// For K = 2 the latter is [(T_A - I) D_B + (T_B - I) D_A] / 2. Value and gradient are unbiased; the
// value may be negative.
//
// Sums in double, in the order of the pixels: the result does not depend on where the estimates
// come from. Throws Error (invalid input) unless there are two estimates at least, all with as many
// derivatives, all arrays have the size of the image, and some weighted pixel of the image is not
// 0.
LossWithGradient weighted_image_loss(std::span<const float> image, std::span<const float> weight,
                                     std::span<const RenderEstimate> estimates);

// Tells where samples are needed for the gradient (RenderRequest::sampling_weights). The noise of
// the term of pixel p, w_p^2 (T_p - I_p) dT_p, is that of T_p or dT_p times w_p^2 and dT_p or T_p -
// I_p, and these are in proportion to T_p, more or less, which is about I_p:
//
//   sampling weight_p = w_p^2 (|I_p| + mean of |I| / 4).
//
// scaled to a maximum of 1. The mean is over the weighted pixels, and sees to it that none of them
// goes without samples. Image and weight have the same size.
std::vector<float> loss_sampling_weights(std::span<const float> image,
                                         std::span<const float> weight);

}  // namespace itn
