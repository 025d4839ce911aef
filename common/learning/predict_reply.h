// Estimates as messages.
#pragma once

#include <span>
#include <string>

#include "common/learning/predictor.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// One estimate for each channel, by the model of this name.
v1::PredictReply to_reply(std::span<const MaterialEstimate> estimates, const std::string& model);

}  // namespace itn
