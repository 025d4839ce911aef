// What is known of a photograph beside its pixels (v1::Capture), and what follows from it for a
// model's answer.
#pragma once

#include <stop_token>
#include <vector>

#include "common/image/photograph.h"
#include "itn/v1/learning.pb.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// Throws Error (invalid input) that names the field and its range.
void validate(const v1::Capture& capture, int channels);

// By what a channel's radiance is multiplied to be on the scale of the images that the model was
// trained with: 1 where nobody knows, and where the model does not care. Requires a valid capture.
// Throws Error (invalid input) if there is a white card, of which the model can make nothing.
double radiance_factor(const v1::Capture& capture, const v1::Model& model, int channel);

// What limits how far an answer to this valid photograph can be trusted, by channel. Throws Error
// (cancelled) within milliseconds of a stop.
std::vector<std::vector<v1::Warning>> warnings(const Photograph& photograph,
                                               const v1::Capture& capture, const v1::Model& model,
                                               const std::stop_token& stop = {});

}  // namespace itn
