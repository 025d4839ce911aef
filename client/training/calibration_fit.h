// Fits the widths of a network's answers to images that it has not learned from.
#pragma once

#include <optional>
#include <span>
#include <stop_token>

#include <torch/types.h>

#include "client/training/image_source.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// The correction under which the truth in standardised coordinates (images x 3) is most likely,
// given answers (images x 9, as common/learning/gaussian.h). Deterministic.
v1::Calibration fit_calibration(const torch::Tensor& outputs, const torch::Tensor& truth);

// The level that holds nine of ten further truths at least, on average, where levels that reach
// those of n others were these: the one of rank (n + 1) 0.9 (split conformal prediction, as
// Calibration in learning.proto). 1 if there are less than nine.
double conformal_level(std::span<const double> levels);

// The correction of a model with weights, from up to 4096 images, evenly spread. Nothing if its
// output is not GAUSSIAN, or if there are less than 256 images: a width is known to one part in the
// square root of twice their number, and is corrected by some hundredths. From twice as many
// images, every second one is for the intervals' levels, which must not be those that the widths
// come from. Throws Error (cancelled) soon after a stop.
std::optional<v1::Calibration> measure_calibration(const v1::Model& model,
                                                   const HeldOutImages& held_out,
                                                   const std::stop_token& stop = {});

}  // namespace itn
