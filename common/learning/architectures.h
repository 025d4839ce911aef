// The architectures of encoder networks, each a file. Where one is chosen: encoder.h.
#pragma once

#include <cstdint>
#include <vector>

#include "common/learning/encoder.h"
#include "common/learning/tensor_data.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// What a network is between.
struct EncoderShape {
  uint32_t resolution = 0;     // of the input, a power of two in [16, 256]
  int64_t input_channels = 0;  // network_input.h
  int64_t outputs = 0;
};

// Each pair of functions throws Error (invalid input) if the architecture's numbers are out of
// range. The shapes are those of all_tensors() of the network; nothing is allocated for them.
std::vector<TensorShape> tensor_shapes(const v1::PlainConvolutions& architecture,
                                       const EncoderShape& ends);
Encoder new_encoder(const v1::PlainConvolutions& architecture, const EncoderShape& ends);

std::vector<TensorShape> tensor_shapes(const v1::ResidualConvolutions& architecture,
                                       const EncoderShape& ends);
Encoder new_encoder(const v1::ResidualConvolutions& architecture, const EncoderShape& ends);

}  // namespace itn
