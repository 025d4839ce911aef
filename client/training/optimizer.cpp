#include "client/training/optimizer.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include <fmt/format.h>
#include <torch/optim/adam.h>

#include "common/error.h"

namespace itn {
namespace {

// --- Muon ---

constexpr double kMomentum = 0.95;
// Root mean square of Adam's steps over the learning rate: with it one learning rate fits both (Liu
// et al., "Muon is scalable for LLM training", 2025).
constexpr double kStepSize = 0.2;

// The gradient with Nesterov's momentum, as an orthogonal matrix of output channels by all others.
void muon_step(const torch::Tensor& kernel, torch::Tensor& momentum, double learning_rate,
               torch::Dtype precision) {
  momentum.mul_(kMomentum).add_(kernel.grad());
  const torch::Tensor ahead = kernel.grad() + kMomentum * momentum;
  const torch::Tensor direction = orthogonalized(ahead.flatten(1), precision);
  const auto longer_side = static_cast<double>(std::max(direction.size(0), direction.size(1)));
  kernel.add_(direction.view(kernel.sizes()), -learning_rate * kStepSize * std::sqrt(longer_side));
}

// Whether it is a kernel of a hidden layer: such a layer comes after the first convolution and has
// a matrix for each pixel of its kernel.
bool is_hidden_kernel(const torch::Tensor& parameter, bool any_before) {
  return parameter.dim() == 4 && any_before;
}

// --- Adam ---

// LibTorch 1 keys the states by the address as text, LibTorch 2 by the address.
template <typename States>
typename States::key_type state_key(const States& /*states*/, const torch::Tensor& parameter) {
  if constexpr (std::is_same_v<typename States::key_type, std::string>) {
    return c10::guts::to_string(parameter.unsafeGetTensorImpl());
  } else {
    return parameter.unsafeGetTensorImpl();
  }
}

torch::Tensor restored(const v1::Tensor& proto, const torch::Tensor& like) {
  torch::Tensor tensor = torch::empty_like(like, torch::MemoryFormat::Contiguous);
  copy_values(proto, tensor);
  return tensor;
}

}  // namespace

torch::Tensor orthogonalized(const torch::Tensor& x, torch::Dtype precision) {
  constexpr int kIterations = 5;
  constexpr double kA = 3.4445, kB = -4.7750, kC = 2.0315;  // Jordan et al.
  constexpr double kNothing = 1e-7;
  const bool tall = x.size(0) > x.size(1);
  torch::Tensor y = ((tall ? x.t() : x) / (x.norm() + kNothing)).to(precision);
  for (int i = 0; i < kIterations; ++i) {
    const torch::Tensor a = y.matmul(y.t());
    y = kA * y + (kB * a + kC * a.matmul(a)).matmul(y);
  }
  return (tall ? y.t() : y).to(torch::kFloat32);
}

Optimizer::Optimizer(const EncoderNetwork& encoder, const v1::TrainingConfig& config)
    : precision_(config.precision() == v1::TrainingConfig::BFLOAT16 ? torch::kBFloat16
                                                                    : torch::kFloat32) {
  std::vector<torch::Tensor> tensors;
  bool any_kernel = false;
  for (const auto& item : encoder.named_parameters()) {
    const torch::Tensor& tensor = item.value();
    if (config.optimizer() == v1::TrainingConfig::MUON && is_hidden_kernel(tensor, any_kernel)) {
      kernels_.push_back(
          {{item.key(), tensor}, torch::zeros_like(tensor, torch::MemoryFormat::Contiguous)});
    } else {
      parameters_.push_back({item.key(), tensor});
      tensors.push_back(tensor);
    }
    any_kernel |= tensor.dim() == 4;
  }
  adam_ = std::make_unique<torch::optim::Adam>(tensors,
                                               torch::optim::AdamOptions(config.learning_rate()));
}

Optimizer::~Optimizer() = default;
Optimizer::Optimizer(Optimizer&&) noexcept = default;
Optimizer& Optimizer::operator=(Optimizer&&) noexcept = default;

void Optimizer::step(double learning_rate) {
  for (torch::optim::OptimizerParamGroup& group : adam_->param_groups()) {
    group.options().set_lr(learning_rate);
  }
  adam_->step();
  const torch::NoGradGuard no_gradient;
  for (Kernel& kernel : kernels_) {
    muon_step(kernel.parameter.tensor, kernel.momentum, learning_rate, precision_);
  }
  ++steps_;
}

v1::OptimizerState Optimizer::state() const {
  v1::OptimizerState proto;
  proto.set_steps(steps_);
  if (steps_ == 0) return proto;
  for (const Kernel& kernel : kernels_) {
    *proto.add_tensors() = to_proto("momentum." + kernel.parameter.name, kernel.momentum);
  }
  for (const Parameter& parameter : parameters_) {
    const auto& entry = adam_->state().at(state_key(adam_->state(), parameter.tensor));
    auto& state = static_cast<torch::optim::AdamParamState&>(*entry);
    *proto.add_tensors() = to_proto("exp_avg." + parameter.name, state.exp_avg());
    *proto.add_tensors() = to_proto("exp_avg_sq." + parameter.name, state.exp_avg_sq());
  }
  return proto;
}

std::vector<TensorShape> Optimizer::state_shapes() const {
  std::vector<TensorShape> shapes;
  for (const Kernel& kernel : kernels_) {
    shapes.push_back({"momentum." + kernel.parameter.name, kernel.momentum.sizes().vec()});
  }
  for (const Parameter& parameter : parameters_) {
    const std::vector<int64_t> shape = parameter.tensor.sizes().vec();
    shapes.push_back({"exp_avg." + parameter.name, shape});
    shapes.push_back({"exp_avg_sq." + parameter.name, shape});
  }
  return shapes;
}

void Optimizer::restore(const v1::OptimizerState& state) {
  try {
    validate(state.tensors(), state.steps() == 0 ? std::vector<TensorShape>() : state_shapes());
  } catch (const Error& error) {
    throw invalid_input(fmt::format(
        "the optimizer's state is not that of this optimizer and network: {}", error.what()));
  }
  const torch::NoGradGuard no_gradient;
  steps_ = state.steps();
  adam_->state().clear();
  if (steps_ == 0) {
    for (Kernel& kernel : kernels_) kernel.momentum.zero_();
    return;
  }
  int index = 0;
  for (Kernel& kernel : kernels_) copy_values(state.tensors(index++), kernel.momentum);
  for (const Parameter& parameter : parameters_) {
    auto moments = std::make_unique<torch::optim::AdamParamState>();
    moments->step(static_cast<int64_t>(steps_));
    moments->exp_avg(restored(state.tensors(index++), parameter.tensor));
    moments->exp_avg_sq(restored(state.tensors(index++), parameter.tensor));
    adam_->state()[state_key(adam_->state(), parameter.tensor)] = std::move(moments);
  }
}

}  // namespace itn
