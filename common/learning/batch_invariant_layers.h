// Layers whose answer for an image depends on no other image of the batch, bit for bit, in
// prediction (eval()). Torch's own take another way for other numbers of images, which sum in
// another order: convolutions of one small image, and matrix products of many rows.
#pragma once

#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>

namespace itn {

// Does what the layer's forward() does. Requires stride, padding and dilation in numbers, and zeros
// as padding.
torch::Tensor batch_invariant_conv2d(torch::nn::Conv2dImpl& layer, const torch::Tensor& input);

// Does what the layer's forward() does, for batch x features.
torch::Tensor batch_invariant_linear(torch::nn::LinearImpl& layer, const torch::Tensor& input);

// The sum of batch x channels x height x width over height and width.
torch::Tensor sum_of_planes(const torch::Tensor& x);

}  // namespace itn
