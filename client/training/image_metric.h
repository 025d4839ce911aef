// The image term of inverse transport networks near the truth, without a render: what derivative
// images say of how far the image of another material is.
#pragma once

#include <span>
#include <stop_token>
#include <vector>

#include "client/training/training_set.h"
#include "common/learning/parameterization.h"

namespace itn {

// M[i][j], symmetric, in the order sigma_t, albedo, g.
using ImageMetric = Jacobian;

// To first order, the image of the material pi + d is I + J d, J = dI/dpi, and the image term
// (rendering_loss.h) of pi + d against the image I of pi is d^T M d (Gauss-Newton), with
//
//   M = sum_p w_p^2 J_p^T J_p / sum_p w_p^2 I_p^2.
//
// A product of an estimate of J with itself would be biased by its noise; M is the mean of the
// products of the two estimates with each other, both ways, and so unbiased. It may be indefinite.
// Throws Error (invalid input) unless all have the size of the image, and some weighted pixel of
// it is not 0.
ImageMetric image_metric(std::span<const float> image, std::span<const float> weight,
                         const DerivativeImages& derivatives);

// How much the pixels of an image count: w, in [0, 1].
std::vector<float> image_weights(const DatasetImage& image, int resolution,
                                 v1::TrainingConfig::ImageWeights weights);

// Of every image. Throws as image_metric() and LabelledImages do, and Error (cancelled) soon after
// a stop is requested.
std::vector<ImageMetric> image_metrics(const LabelledImages& images,
                                       v1::TrainingConfig::ImageWeights weights,
                                       std::stop_token stop = {});

}  // namespace itn
