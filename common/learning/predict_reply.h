// Estimates as messages.
#pragma once

#include <span>

#include "common/learning/predictor.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// One estimate for each channel, by this model.
v1::PredictReply to_reply(std::span<const MaterialEstimate> estimates,
                          const v1::ModelVersion& model);

// One outcome for each photograph; an error is the status that a call of its own would have had.
v1::PredictBatchReply to_reply(const Predictor::Outcomes& outcomes, const v1::ModelVersion& model);

}  // namespace itn
