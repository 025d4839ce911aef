#include "client/training/weight_average.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

Encoder small_encoder() {
  v1::Model model;
  model.set_resolution(16);
  model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(1);
  model.set_output(v1::POINT);
  return new_encoder(model);
}

void fill(const Encoder& encoder, double value) {
  const torch::NoGradGuard no_gradient;
  for (torch::Tensor& parameter : encoder->parameters()) parameter.fill_(value);
}

// A network whose weights are the means.
Encoder mean_of(const WeightAverage& average) {
  const torch::NoGradGuard no_gradient;
  Encoder encoder = small_encoder();
  const std::vector<NamedTensor> tensors = all_tensors(*encoder);
  for (size_t i = 0; i < tensors.size(); ++i) {
    torch::Tensor(tensors[i].tensor).copy_(average.means().at(i).tensor);
  }
  return encoder;
}

// The value that all weights have.
double value_of(const WeightAverage& average) {
  const Encoder encoder = mean_of(average);
  const double first = encoder->parameters()[0].flatten()[0].item<double>();
  for (const torch::Tensor& parameter : encoder->parameters()) {
    EXPECT_TRUE((parameter == first).all().item<bool>());
  }
  return first;
}

TEST(WeightAverageTest, FollowsTheRecurrence) {
  const Encoder encoder = small_encoder();
  fill(encoder, 1);
  WeightAverage average(*encoder, 0.5);
  double expected = 1;
  for (int n = 1; n <= 20; ++n) {
    fill(encoder, n % 3);
    average.update(*encoder);
    const double decay = std::min(0.5, (1.0 + n) / (10.0 + n));
    expected = decay * expected + (1 - decay) * (n % 3);
    EXPECT_NEAR(value_of(average), expected, 1e-6);
  }
}

TEST(WeightAverageTest, WithoutDecayItIsTheNetwork) {
  const Encoder encoder = small_encoder();
  fill(encoder, 1);
  WeightAverage average(*encoder, 0);
  fill(encoder, 7);
  average.update(*encoder);
  EXPECT_EQ(value_of(average), 7);
}

TEST(WeightAverageTest, GoesOnFromWhereItWas) {
  const Encoder encoder = small_encoder();
  fill(encoder, 1);
  WeightAverage whole(*encoder, 0.9);
  for (int n = 0; n < 4; ++n) {
    fill(encoder, n);
    whole.update(*encoder);
  }
  WeightAverage resumed(*encoder, 0.9);
  resumed.restore(*mean_of(whole), 4);
  for (int n = 4; n < 8; ++n) {
    fill(encoder, n);
    whole.update(*encoder);
    resumed.update(*encoder);
  }
  EXPECT_EQ(value_of(whole), value_of(resumed));
}

TEST(WeightAverageTest, DoesNotShareStorageWithTheNetwork) {
  const Encoder encoder = small_encoder();
  fill(encoder, 1);
  const WeightAverage average(*encoder, 0.9);
  fill(encoder, 2);
  EXPECT_EQ(value_of(average), 1);
}

}  // namespace
}  // namespace itn
