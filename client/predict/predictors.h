// Who is asked about photographs: a network in this process, or a predictor over RPC.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include "client/predict/photograph_input.h"
#include "client/rpc/client_security.h"
#include "itn/v1/dataset.pb.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// An outcome for each photograph, and what they say together if they show one material.
using Predict = std::function<v1::PredictBatchReply(std::span<const PredictInput> photographs,
                                                    bool one_material)>;

// By the network in the file or folder `model`. Throws Error as Predictor::load().
Predict predictor_here(const std::filesystem::path& model);

// By the model that comes with itn of the name that `model_of` says for each photograph, or, of one
// material, for the first of them. Throws Error as find_model() and Predictor::load().
using ModelOf = std::function<std::string(const PredictInput&)>;
Predict predictor_here(const ModelOf& model_of);

// What the network in this file or folder can answer, for an object of 1 mm. Throws likewise.
v1::MaterialRange range_of_model(const std::filesystem::path& model);

// By the itn-predictor at HOST:PORT; a call takes no longer than `timeout`. `model` and `version`:
// as in PredictRequest. More photographs than it takes at a time are asked about in several calls,
// unless they show one material. Throws Error as Connector.
Predict predictor_at(const std::string& address, const ClientSecurity& security,
                     std::chrono::milliseconds timeout, const std::string& model,
                     const std::string& version);

}  // namespace itn
