// Descends along the gradients of a network, and gives what it remembers between two steps as data.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <torch/types.h>

#include "common/learning/encoder.h"
#include "common/learning/tensor_data.h"
#include "itn/v1/learning.pb.h"

namespace torch::optim {
class Adam;
}

namespace itn {

// An optimizer of a kind that v1::TrainingConfig::Optimizer describes.
class Optimizer {
 public:
  // Has the configuration's kind and precision, for the parameters that the network has now.
  Optimizer(const EncoderNetwork& encoder, const v1::TrainingConfig& config);
  ~Optimizer();
  Optimizer(Optimizer&&) noexcept;
  Optimizer& operator=(Optimizer&&) noexcept;

  // Requires that all parameters have gradients.
  void step(double learning_rate);

  v1::OptimizerState state() const;
  // Puts the state in the place of the optimizer's. Throws Error (invalid input) if it is not that
  // of an optimizer of this kind and network.
  void restore(const v1::OptimizerState& state);

 private:
  struct Parameter {
    std::string name;
    torch::Tensor tensor;
  };
  struct Kernel {
    Parameter parameter;
    torch::Tensor momentum;
  };

  std::vector<TensorShape> state_shapes() const;

  std::vector<Kernel> kernels_;        // Muon's
  std::vector<Parameter> parameters_;  // Adam's: the rest
  std::unique_ptr<torch::optim::Adam> adam_;
  torch::Dtype precision_;  // of Muon's products
  uint64_t steps_ = 0;
};

// Nearly the orthogonal matrix that is closest to x (rows x columns): with the singular vectors of
// x, and singular values from 0.68 to 1.21 in the place of all that are not tiny beside the
// largest. The quintic Newton-Schulz iteration of Jordan et al., "Muon: an optimizer for hidden
// layers in neural networks", 2024. `precision`: of the products.
torch::Tensor orthogonalized(const torch::Tensor& x, torch::Dtype precision);

}  // namespace itn
