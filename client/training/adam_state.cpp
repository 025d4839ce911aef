#include "client/training/adam_state.h"

#include <fmt/format.h>

#include <type_traits>

#include "common/error.h"

namespace itn {
namespace {

// LibTorch 1 keys the states by the address as text, LibTorch 2 by the address.
template <typename States>
typename States::key_type state_key(const States& /*states*/, const torch::Tensor& parameter) {
  if constexpr (std::is_same_v<typename States::key_type, std::string>) {
    return c10::guts::to_string(parameter.unsafeGetTensorImpl());
  } else {
    return parameter.unsafeGetTensorImpl();
  }
}

std::vector<TensorShape> moment_shapes(const EncoderNetwork& encoder) {
  std::vector<TensorShape> shapes;
  for (const auto& parameter : encoder.named_parameters()) {
    const std::vector<int64_t> shape = parameter.value().sizes().vec();
    shapes.push_back({"exp_avg." + parameter.key(), shape});
    shapes.push_back({"exp_avg_sq." + parameter.key(), shape});
  }
  return shapes;
}

torch::Tensor moment(const v1::Tensor& proto, const torch::Tensor& parameter) {
  torch::Tensor tensor = torch::empty_like(parameter, torch::MemoryFormat::Contiguous);
  copy_values(proto, tensor);
  return tensor;
}

}  // namespace

v1::OptimizerState state_of(torch::optim::Adam& optimizer, const EncoderNetwork& encoder) {
  v1::OptimizerState proto;
  for (const auto& parameter : encoder.named_parameters()) {
    const auto entry = optimizer.state().find(state_key(optimizer.state(), parameter.value()));
    if (entry == optimizer.state().end()) {  // before the first step
      return proto;
    }
    const auto& state = static_cast<torch::optim::AdamParamState&>(*entry->second);
    proto.set_steps(static_cast<uint64_t>(state.step()));  // the same for all
    *proto.add_tensors() = to_proto("exp_avg." + parameter.key(), state.exp_avg());
    *proto.add_tensors() = to_proto("exp_avg_sq." + parameter.key(), state.exp_avg_sq());
  }
  return proto;
}

void restore_state(torch::optim::Adam& optimizer, const EncoderNetwork& encoder,
                   const v1::OptimizerState& state) {
  try {
    validate(state.tensors(),
             state.steps() == 0 ? std::vector<TensorShape>() : moment_shapes(encoder));
  } catch (const Error& error) {
    throw invalid_input(
        fmt::format("the optimizer's state is not that of this network: {}", error.what()));
  }
  optimizer.state().clear();
  if (state.steps() == 0) {
    return;
  }
  const torch::NoGradGuard no_gradient;
  int index = 0;
  for (const torch::Tensor& parameter : encoder.parameters()) {
    auto restored = std::make_unique<torch::optim::AdamParamState>();
    restored->step(static_cast<int64_t>(state.steps()));
    restored->exp_avg(moment(state.tensors(index++), parameter));
    restored->exp_avg_sq(moment(state.tensors(index++), parameter));
    optimizer.state()[state_key(optimizer.state(), parameter)] = std::move(restored);
  }
}

}  // namespace itn
