#include "client/training/adam_state.h"

#include <fmt/format.h>

#include <sstream>
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

std::vector<torch::Tensor> parameters_of(torch::optim::Adam& optimizer) {
  std::vector<torch::Tensor> parameters;
  for (const torch::optim::OptimizerParamGroup& group : optimizer.param_groups()) {
    parameters.insert(parameters.end(), group.params().begin(), group.params().end());
  }
  return parameters;
}

}  // namespace

std::string serialize_state(torch::optim::Adam& optimizer) {
  torch::serialize::OutputArchive archive;
  int64_t index = 0;
  for (const torch::Tensor& parameter : parameters_of(optimizer)) {
    // Before the first step there is none.
    const auto entry = optimizer.state().find(state_key(optimizer.state(), parameter));
    if (entry != optimizer.state().end()) {
      const auto& state = static_cast<torch::optim::AdamParamState&>(*entry->second);
      archive.write(fmt::format("step_{}", index), torch::tensor(state.step()));
      archive.write(fmt::format("exp_avg_{}", index), state.exp_avg());
      archive.write(fmt::format("exp_avg_sq_{}", index), state.exp_avg_sq());
    }
    ++index;
  }
  std::ostringstream stream;
  archive.save_to(stream);
  return std::move(stream).str();
}

void restore_state(torch::optim::Adam& optimizer, const std::string& bytes) {
  const auto damaged = [](const std::string& how) {
    return Error(ErrorKind::kDataLoss,
                 fmt::format("the optimizer's state cannot be restored: {}", how));
  };
  torch::serialize::InputArchive archive;
  try {
    archive.load_from(bytes.data(), bytes.size());
  } catch (const std::exception& error) {
    throw damaged(error.what());
  }
  optimizer.state().clear();
  int64_t index = 0;
  for (const torch::Tensor& parameter : parameters_of(optimizer)) {
    torch::Tensor step, exp_avg, exp_avg_sq;
    if (archive.try_read(fmt::format("step_{}", index), step)) {
      if (!archive.try_read(fmt::format("exp_avg_{}", index), exp_avg) ||
          !archive.try_read(fmt::format("exp_avg_sq_{}", index), exp_avg_sq) ||
          exp_avg.sizes() != parameter.sizes() || exp_avg_sq.sizes() != parameter.sizes()) {
        throw damaged("it is of another network");
      }
      auto state = std::make_unique<torch::optim::AdamParamState>();
      state->step(step.item<int64_t>());
      state->exp_avg(exp_avg);
      state->exp_avg_sq(exp_avg_sq);
      optimizer.state()[state_key(optimizer.state(), parameter)] = std::move(state);
    }
    ++index;
  }
}

}  // namespace itn
