// A running mean of a network's weights, which predicts better than the weights of any one step.
#pragma once

#include <cstdint>
#include <vector>

#include "common/learning/encoder.h"

namespace itn {

// mean <- mean + (1 - d) (weights - mean), d = min(decay, (1 + n) / (10 + n)) after n updates, so
// that the random weights of the start are soon forgotten. Of all tensors of the network: weights
// and running statistics.
class WeightAverage {
 public:
  // Starts as a copy of the network's. `decay` in [0, 1); 0 follows the network.
  WeightAverage(const EncoderNetwork& encoder, double decay);

  void update(const EncoderNetwork& encoder);

  // In the order of all_tensors().
  const std::vector<NamedTensor>& means() const { return means_; }
  // Takes a network's tensors as the means after `updates`.
  void restore(const EncoderNetwork& encoder, uint64_t updates);

 private:
  double decay_;
  uint64_t updates_ = 0;
  std::vector<NamedTensor> means_;
};

}  // namespace itn
