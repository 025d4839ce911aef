#include "client/training/weight_average.h"

#include <algorithm>

namespace itn {
WeightAverage::WeightAverage(const EncoderNetwork& encoder, double decay) : decay_(decay) {
  restore(encoder, 0);
}

void WeightAverage::update(const EncoderNetwork& encoder) {
  const torch::NoGradGuard no_gradient;
  const auto n = static_cast<double>(++updates_);
  const double decay = std::min(decay_, (1 + n) / (10 + n));
  const std::vector<NamedTensor> tensors = all_tensors(encoder);
  for (size_t i = 0; i < tensors.size(); ++i) means_[i].tensor.lerp_(tensors[i].tensor, 1 - decay);
}

void WeightAverage::restore(const EncoderNetwork& encoder, uint64_t updates) {
  updates_ = updates;
  means_ = all_tensors(encoder);
  for (NamedTensor& mean : means_) mean.tensor = mean.tensor.detach().clone();
}

}  // namespace itn
