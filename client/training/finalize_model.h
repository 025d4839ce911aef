// What a trained network is told of itself before it predicts for others.
#pragma once

#include <stop_token>

#include "client/training/image_source.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// Sets the model's outlier_model (measure_outlier_model()), which it loses if there are too few
// images to measure it by, and its calibration (measure_calibration()), which stays as it is if
// there are too few. A model that was trained with cameras is shown all images through cameras.
// Throws Error (cancelled) soon after a stop.
void finalize_model(const ImageSource& training, const HeldOutImages& held_out, v1::Model& model,
                    const std::stop_token& stop = {});

}  // namespace itn
