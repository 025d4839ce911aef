#include "client/training/optimizer.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <torch/optim/adam.h>

#include "common/error.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using testing::expect_error;

v1::TrainingConfig config(v1::TrainingConfig::Optimizer kind) {
  v1::TrainingConfig config;
  config.set_optimizer(kind);
  config.set_learning_rate(0.01);
  return config;
}

// Gradients that are random, but the same for the same step.
void set_gradients(const EncoderNetwork& encoder, uint64_t step) {
  torch::manual_seed(step);
  for (const torch::Tensor& parameter : encoder.parameters()) {
    parameter.mutable_grad() = torch::randn_like(parameter);
  }
}

void take_steps(Optimizer& optimizer, const EncoderNetwork& encoder, uint64_t first, uint64_t end) {
  for (uint64_t step = first; step < end; ++step) {
    set_gradients(encoder, step);
    optimizer.step(0.01);
  }
}

std::vector<torch::Tensor> values(const EncoderNetwork& encoder) {
  std::vector<torch::Tensor> copies;
  for (const torch::Tensor& parameter : encoder.parameters()) {
    copies.push_back(parameter.detach().clone());
  }
  return copies;
}

void expect_equal(const EncoderNetwork& a, const EncoderNetwork& b) {
  for (size_t i = 0; i < a.parameters().size(); ++i) {
    EXPECT_TRUE(torch::equal(a.parameters()[i], b.parameters()[i])) << "parameter " << i;
  }
}

TEST(Orthogonalized, KeepsSingularVectorsAndMakesSingularValuesAlike) {
  for (const auto& [rows, columns] : {std::pair{12, 40}, {40, 12}, {24, 24}}) {
    torch::manual_seed(2);
    const torch::Tensor x = torch::randn({rows, columns});
    const auto [u, s, vh] = torch::linalg_svd(x, false);
    const torch::Tensor inner = u.t().matmul(orthogonalized(x, torch::kFloat32)).matmul(vh.t());
    const torch::Tensor singular_values = inner.diagonal();
    EXPECT_LT((inner - singular_values.diag()).abs().max().item<double>(), 0.01);
    EXPECT_LT(singular_values.max().item<double>(), 1.22);
    // A square matrix has tiny singular values, which five iterations do not bring up.
    if (rows != columns) {
      EXPECT_GT(singular_values.min().item<double>(), 0.67);
    }
  }
}

TEST(Orthogonalized, OfNothingIsNothing) {
  EXPECT_EQ(orthogonalized(torch::zeros({3, 5}), torch::kFloat32).abs().max().item<float>(), 0);
}

TEST(Optimizer, OfAdamIsTorchs) {
  const Encoder ours = load_encoder(residual_model()), torchs = load_encoder(residual_model());
  Optimizer optimizer(*ours, config(v1::TrainingConfig::ADAM));
  torch::optim::Adam adam(torchs->parameters(), torch::optim::AdamOptions(0.01));
  take_steps(optimizer, *ours, 0, 3);
  for (uint64_t step = 0; step < 3; ++step) {
    set_gradients(*torchs, step);
    adam.step();
  }
  expect_equal(*ours, *torchs);
}

// The root mean square of a step is a fifth of the learning rate: as Adam's often is.
TEST(Optimizer, OfMuonMovesHiddenKernelsByOrthogonalSteps) {
  const Encoder encoder = load_encoder(residual_model()), adams = load_encoder(residual_model());
  const std::vector<torch::Tensor> before = values(*encoder);
  Optimizer muon(*encoder, config(v1::TrainingConfig::MUON));
  Optimizer adam(*adams, config(v1::TrainingConfig::ADAM));
  take_steps(muon, *encoder, 0, 1);
  take_steps(adam, *adams, 0, 1);
  const std::vector<torch::Tensor> after = values(*encoder), adams_after = values(*adams);
  int kernels = 0;
  for (size_t i = 0; i < after.size(); ++i) {
    if (torch::equal(after[i], adams_after[i])) continue;
    ++kernels;
    ASSERT_EQ(after[i].dim(), 4);
    const torch::Tensor step = (after[i] - before[i]).flatten(1);
    const auto root_mean_square = step.square().mean().sqrt().item<double>();
    EXPECT_NEAR(root_mean_square, 0.2 * 0.01, 0.3 * 0.2 * 0.01);
  }
  // Every kernel but the stem's.
  const auto all =
      std::ranges::count_if(after, [](const torch::Tensor& t) { return t.dim() == 4; });
  EXPECT_EQ(kernels, all - 1);
}

TEST(Optimizer, GoesOnFromItsState) {
  for (const auto kind : {v1::TrainingConfig::ADAM, v1::TrainingConfig::MUON}) {
    const Encoder straight = load_encoder(residual_model());
    Optimizer optimizer(*straight, config(kind));
    take_steps(optimizer, *straight, 0, 4);
    const Encoder stopped = load_encoder(residual_model());
    Optimizer first(*stopped, config(kind));
    take_steps(first, *stopped, 0, 2);
    Optimizer second(*stopped, config(kind));
    second.restore(first.state());
    take_steps(second, *stopped, 2, 4);
    expect_equal(*straight, *stopped);
  }
}

TEST(Optimizer, RefusesTheStateOfAnother) {
  const Encoder encoder = load_encoder(residual_model());
  Optimizer adam(*encoder, config(v1::TrainingConfig::ADAM));
  Optimizer muon(*encoder, config(v1::TrainingConfig::MUON));
  take_steps(adam, *encoder, 0, 1);
  expect_error(ErrorKind::kInvalidInput, {"momentum"}, [&] { muon.restore(adam.state()); });
  EXPECT_NO_THROW(muon.restore(v1::OptimizerState())) << "before its first step it has none";
}

}  // namespace
}  // namespace itn
