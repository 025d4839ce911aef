#include "client/training/loss.h"

#include <gmock/gmock.h>

#include "common/learning/gaussian.h"

namespace itn {
namespace {

Batch batch_of(const torch::Tensor& targets) {
  return {.step = 0, .items = {}, .targets = targets};
}

TEST(LikelihoodLoss, IsMinusTheLogDensityWhateverTheWeightOfTheMean) {
  torch::manual_seed(1);
  const torch::Tensor outputs = torch::randn({5, 9}), targets = torch::randn({5, 3});
  const auto expected = negative_log_likelihood(outputs, targets).mean().item<double>();
  for (const double weight : {0.0, 0.5}) {
    LikelihoodLoss loss(weight);
    EXPECT_NEAR(loss.evaluate(batch_of(targets), outputs).value, expected, 1e-6);
  }
}

// What the weight adds is the gradient of the squared distance, and of nothing but the means.
TEST(LikelihoodLoss, PullsTheMeanToTheTruth) {
  torch::manual_seed(1);
  const torch::Tensor outputs = torch::randn({5, 9}), targets = torch::randn({5, 3});
  LikelihoodLoss density(0), both(0.5);
  const torch::Tensor added = both.evaluate(batch_of(targets), outputs).gradient -
                              density.evaluate(batch_of(targets), outputs).gradient;
  EXPECT_TRUE(torch::allclose(added.slice(1, 0, 3), outputs.slice(1, 0, 3) - targets, 1e-4, 1e-5));
  EXPECT_EQ(added.slice(1, 3).abs().max().item<float>(), 0);
}

}  // namespace
}  // namespace itn
