// Answers of predictors as what itn predict prints.
#pragma once

#include <string>
#include <vector>

#include "client/predict/photograph_input.h"
#include "common/material.h"
#include "itn/v1/learning.pb.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// What was answered about a photograph, or, by its first, about several of one material: `name`
// names them. Throws Error (internal) if the answer does not fit to the photograph's channels.
v1::Prediction prediction_of(const std::string& name, const v1::PredictReply& reply,
                             const PredictInput& photograph);

// The best guesses, by channel, for an object whose longest side is 1 mm.
std::vector<Material> materials_of_1_mm(const v1::Prediction& prediction);

// The answer for a photograph that could not be used.
v1::Prediction failure_of(const std::string& name, const std::string& what);

}  // namespace itn
