// How fast a network learns as training goes on.
#pragma once

#include <cstdint>

#include "itn/v1/learning.pb.h"

namespace itn {

// The learning rate of the step that comes after `steps` have been taken. CONSTANT: the
// configuration's. COSINE: rises in proportion to the step over `warmup_steps`, then falls along
// half a cosine to one hundredth at the last step (Loshchilov and Hutter, "SGDR", ICLR 2017,
// without restarts).
double learning_rate(const v1::TrainingConfig& config, uint64_t steps);

}  // namespace itn
