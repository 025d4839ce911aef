#include "common/learning/batch_invariant_layers.h"

#include <vector>

namespace itn {

// oneDNN computes an image the same way whatever the batch is (measured: batches of 1 to 33, one
// and two threads). Torch asks it too, but for single images of up to 20480 numbers.
torch::Tensor batch_invariant_conv2d(torch::nn::Conv2dImpl& layer, const torch::Tensor& input) {
  if (layer.is_training() || !at::globalContext().userEnabledMkldnn() || !at::hasMKLDNN()) {
    return layer.forward(input);
  }
  const auto& options = layer.options;
  const auto format = input.suggest_memory_format();
  return at::mkldnn_convolution(
      input.contiguous(format), layer.weight.contiguous(format),
      layer.bias.defined() ? c10::optional<torch::Tensor>(layer.bias) : c10::nullopt,
      get<torch::ExpandingArray<2>>(options.padding()), options.stride(), options.dilation(),
      options.groups());
}

torch::Tensor batch_invariant_linear(torch::nn::LinearImpl& layer, const torch::Tensor& input) {
  if (layer.is_training()) return layer.forward(input);
  std::vector<torch::Tensor> rows;
  for (int64_t i = 0; i < input.size(0); ++i) {
    rows.push_back(layer.forward(input.slice(0, i, i + 1)));
  }
  return torch::cat(rows);
}

// Row by row: a sum that has one result alone is cut into parts, one for each thread.
torch::Tensor sum_of_planes(const torch::Tensor& x) {
  return x.sum(3).sum(2);
}

}  // namespace itn
