#include "client/training/weight_average.h"

#include <algorithm>

namespace itn {
namespace {

// Weights, then running statistics; tensors that share storage with the network's.
std::vector<torch::Tensor> tensors_of(const EncoderNetwork& encoder) {
  std::vector<torch::Tensor> tensors = encoder.parameters();
  for (const torch::Tensor& buffer : encoder.buffers()) {
    if (buffer.is_floating_point()) {  // not the counts of batches
      tensors.push_back(buffer);
    }
  }
  return tensors;
}

}  // namespace

WeightAverage::WeightAverage(const EncoderNetwork& encoder, double decay) : decay_(decay) {
  restore(encoder, 0);
}

void WeightAverage::update(const EncoderNetwork& encoder) {
  const torch::NoGradGuard no_gradient;
  const auto n = static_cast<double>(++updates_);
  const double decay = std::min(decay_, (1 + n) / (10 + n));
  const std::vector<torch::Tensor> tensors = tensors_of(encoder);
  for (size_t i = 0; i < tensors.size(); ++i) {
    means_[i].lerp_(tensors[i], 1 - decay);
  }
}

void WeightAverage::copy_to(EncoderNetwork& encoder) const {
  const torch::NoGradGuard no_gradient;
  const std::vector<torch::Tensor> tensors = tensors_of(encoder);
  for (size_t i = 0; i < tensors.size(); ++i) {
    torch::Tensor(tensors[i]).copy_(means_[i]);
  }
}

void WeightAverage::restore(const EncoderNetwork& encoder, uint64_t updates) {
  const torch::NoGradGuard no_gradient;
  updates_ = updates;
  means_.clear();
  for (const torch::Tensor& tensor : tensors_of(encoder)) {
    means_.push_back(tensor.detach().clone());
  }
}

}  // namespace itn
