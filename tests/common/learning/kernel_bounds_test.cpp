// No network that can be configured may reach a kernel that writes beyond its tensors. To be run
// with guarded memory (tests/support/guarded_memory.cpp), by each instruction set that oneDNN has
// kernels for: such a kernel ends the process.
#include <ATen/autocast_mode.h>

#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "common/learning/encoder.h"
#include "common/learning/network_input.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/bfloat16.h"

namespace itn {
namespace {

TEST(GuardedMemory, EndsAProcessThatWritesBeyondIt) {
  const auto write_at = [](int64_t offset) {
    const torch::Tensor tensor = torch::zeros({100});
    tensor.data_ptr<float>()[tensor.numel() + offset] = 1;
  };
  EXPECT_DEATH(write_at(0), "beyond its end");
  EXPECT_DEATH(write_at(16), "");
}

// A step of training and a prediction.
void use(const v1::Model& model, int64_t batch, bool bfloat16) {
  const Encoder encoder = new_encoder(model);
  const torch::Tensor input =
      torch::rand({batch, input_channels(model), model.resolution(), model.resolution()});
  at::autocast::set_autocast_cpu_dtype(at::kBFloat16);
  at::autocast::set_cpu_enabled(bfloat16);
  torch::Tensor features = encoder->embed(input);
  at::autocast::clear_cache();
  at::autocast::set_cpu_enabled(false);
  encoder->answer(features.to(torch::kFloat32)).square().sum().backward();
  encoder->eval();
  const torch::NoGradGuard no_gradients;
  encoder->forward(input);
}

void use_in_all_ways(const std::string& name, const v1::Model& model) {
  for (const bool bfloat16 : {false, true}) {
    if (bfloat16 && !testing::has_bfloat16()) continue;
    for (const int64_t batch : {1, 3, 16}) {
      // What is printed last is what ended the process.
      fmt::print(stderr, "{}, resolution {}, batch {}, {}\n", name, model.resolution(), batch,
                 bfloat16 ? "bfloat16" : "float32");
      use(model, batch, bfloat16);
    }
  }
}

class KernelBounds : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override { set_torch_threads(GetParam()); }
};

TEST_P(KernelBounds, AreThoseOfTheTensorsInResidualNetworks) {
  for (const uint32_t resolution : {16, 32, 64}) {
    for (const uint32_t base_channels : {4, 5, 6, 7, 8, 9, 12, 15, 16, 17}) {
      use_in_all_ways(fmt::format("residual, {} base channels", base_channels),
                      untrained_residual(resolution, base_channels, 1));
    }
  }
  use_in_all_ways("residual, 4 base channels, 3 blocks", untrained_residual(32, 4, 3));
}

TEST_P(KernelBounds, AreThoseOfTheTensorsInPlainNetworks) {
  for (const uint32_t resolution : {16, 32}) {
    for (const uint32_t base_channels : {1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 17}) {
      use_in_all_ways(fmt::format("plain, {} base channels", base_channels),
                      untrained(resolution, base_channels));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Threads, KernelBounds, ::testing::Values(1, 2));

}  // namespace
}  // namespace itn
