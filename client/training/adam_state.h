// Adam's state as bytes that depend on nothing but its values.
//
// LibTorch's own torch::save(optimizer) orders and names the moments by the addresses of the
// parameters, so that equal states give different bytes, and torch::load (1.13) does not bring the
// options back.
#pragma once

#include <torch/torch.h>

#include <string>

namespace itn {

std::string serialize_state(torch::optim::Adam& optimizer);

// Puts the state of an optimizer with the same parameters in the same order in place; options stay
// as they are. Throws Error (kDataLoss) if the bytes cannot be read or do not fit.
void restore_state(torch::optim::Adam& optimizer, const std::string& bytes);

}  // namespace itn
