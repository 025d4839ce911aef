// Shows a trained network images of its training and others, so that it will know what it has not
// seen (common/learning/outlier_detector.h).
#pragma once

#include <optional>
#include <stop_token>

#include "client/training/image_source.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// The outlier model of a model with weights, from up to 4096 images of each source, evenly spread,
// less those that are far noisier than most. `held_out`: of shapes that the model was not trained
// with; without any, a quarter of the training images take their place, whose scores are a little
// too small. Nothing if there are less than 32 training images. Deterministic. Throws Error
// (cancelled) soon after a stop.
std::optional<v1::OutlierModel> measure_outlier_model(const v1::Model& model,
                                                      const ImageSource& training,
                                                      const ImageSource& held_out,
                                                      const std::stop_token& stop = {});

}  // namespace itn
