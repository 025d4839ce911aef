#include "common/learning/encoder.h"

#include <vector>

#include <gmock/gmock.h>

#include "common/error.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {
namespace {

int64_t parameter_count(const Encoder& encoder) {
  int64_t count = 0;
  for (const torch::Tensor& p : encoder->parameters()) {
    count += p.numel();
  }
  return count;
}

TEST(Encoder, OfThePaperHasSevenConvolutionsTo1024Channels) {
  const Encoder encoder(128, 16);
  int64_t expected = 0;
  for (int64_t block = 0, in = 2, out = 16; block < 7; ++block, in = out, out *= 2) {
    expected += in * out * 9 + out;
  }
  expected += 1024 * 3 + 3;
  EXPECT_EQ(parameter_count(encoder), expected);
}

TEST(Encoder, TakesEveryResolutionToThreeNumbers) {
  for (const int resolution : {16, 32, 64, 128, 256}) {
    Encoder encoder(resolution, 1);
    const torch::Tensor output = encoder->forward(torch::rand({2, 2, resolution, resolution}));
    EXPECT_EQ(output.sizes(), torch::IntArrayRef({2, 3})) << resolution;
  }
}

TEST(Encoder, RefusesOtherResolutions) {
  for (const int resolution : {0, 8, 48, 100, 512, -16}) {
    EXPECT_THROW(Encoder(resolution, 16), Error) << resolution;
  }
  EXPECT_THROW(Encoder(64, 0), Error);
}

TEST(EncoderInput, IsTheScaledMaskedImageAndTheWeightMap) {
  std::vector<float> luminance(16 * 16, 2), mask(16 * 16, 0);
  mask[5 * 16 + 3] = 1;
  const torch::Tensor input = encoder_input(16, luminance, mask, 0.5);
  EXPECT_EQ(input.sizes(), torch::IntArrayRef({2, 16, 16}));
  EXPECT_EQ(input[0][5][3].item<float>(), 1);
  EXPECT_EQ(input[0].sum().item<float>(), 1);
  EXPECT_EQ(input[1][5][3].item<float>(), 1);
  EXPECT_EQ(input[1].sum().item<float>(), 1);
}

TEST(Weights, SurviveARoundTrip) {
  const v1::Model model = small_model();
  Encoder a = load_encoder(model), b = load_encoder(model);
  const torch::Tensor input = torch::rand({1, 2, 16, 16});
  EXPECT_TRUE(torch::equal(a->forward(input), b->forward(input)));
  torch::manual_seed(1);
  Encoder original(16, 2);
  EXPECT_TRUE(torch::equal(a->forward(input), original->forward(input)));
}

TEST(Weights, OfAnotherNetworkAreRefused) {
  v1::Model model = small_model();
  model.set_base_channels(3);
  EXPECT_THROW(load_encoder(model), Error);
  model.set_base_channels(2);
  model.set_weights("no archive");
  EXPECT_THROW(load_encoder(model), Error);
}

}  // namespace
}  // namespace itn
