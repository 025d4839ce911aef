// What Adam remembers between two steps, as data that depend on nothing but its values.
#pragma once

#include <torch/torch.h>

#include "common/learning/encoder.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// `optimizer` has the parameters of `encoder`, in their order.
v1::OptimizerState state_of(torch::optim::Adam& optimizer, const EncoderNetwork& encoder);

// Puts the state in the place of the optimizer's; options stay as they are. Throws Error (invalid
// input) if it is not the state of an optimizer of this network.
void restore_state(torch::optim::Adam& optimizer, const EncoderNetwork& encoder,
                   const v1::OptimizerState& state);

}  // namespace itn
