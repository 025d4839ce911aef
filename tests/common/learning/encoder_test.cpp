#include "common/learning/encoder.h"

#include <cmath>
#include <functional>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>

#include "tests/common/learning/model_for_tests.h"
#include "tests/support/address_space.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using namespace testing;

TEST(Encoder, OfThePaperHasSevenConvolutionsTo1024Channels) {
  int64_t count = 0;
  for (const torch::Tensor& p : new_encoder(untrained(128, 16))->parameters()) count += p.numel();
  int64_t expected = 0;
  for (int64_t block = 0, in = 2, out = 16; block < 7; ++block, in = out, out *= 2) {
    expected += in * out * 9 + out;
  }
  expected += 1024 * 3 + 3;
  EXPECT_EQ(count, expected);
}

TEST(Encoder, TakesEveryResolutionToThreeNumbers) {
  for (const int resolution : {16, 32, 64, 128, 256}) {
    const Encoder encoder = new_encoder(untrained(static_cast<uint32_t>(resolution), 1));
    const torch::Tensor output = encoder->forward(torch::rand({2, 2, resolution, resolution}));
    EXPECT_EQ(output.sizes(), torch::IntArrayRef({2, 3})) << resolution;
  }
}

TEST(Encoder, HasTheTensorsThatItIsExpectedToHave) {
  std::vector<v1::Model> models;
  for (const uint32_t resolution : {16, 64, 256}) {
    models.push_back(untrained(resolution, 3));
    for (const uint32_t blocks : {1, 3}) {
      models.push_back(untrained_residual(resolution, 4, blocks));
    }
  }
  for (const v1::Model& model : models) {
    const std::vector<TensorShape> expected = tensor_shapes(model);
    const std::vector<NamedTensor> there = all_tensors(*new_encoder(model));
    ASSERT_EQ(there.size(), expected.size());
    for (size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(there[i].name, expected[i].name);
      EXPECT_EQ(there[i].tensor.sizes(), torch::IntArrayRef(expected[i].shape));
    }
  }
}

TEST(ResidualEncoder, TakesEveryResolutionToNineNumbers) {
  for (const int resolution : {16, 32, 64, 128, 256}) {
    const Encoder encoder =
        new_encoder(untrained_residual(static_cast<uint32_t>(resolution), 4, 1));
    const torch::Tensor output = encoder->forward(torch::rand({2, 4, resolution, resolution}));
    EXPECT_EQ(output.sizes(), torch::IntArrayRef({2, 9})) << resolution;
  }
}

// The pooled statistics are of the object alone, and none is a division by nothing.
TEST(ResidualEncoder, AnswersFinitelyWithoutAnObject) {
  const Encoder encoder = load_encoder(residual_model());
  EXPECT_TRUE(encoder->forward(torch::zeros({1, 4, 32, 32})).isfinite().all().item<bool>());
}

TEST(ResidualEncoder, AnswersEachImageByItself) {
  const Encoder encoder = load_encoder(residual_model());
  torch::manual_seed(3);
  const torch::Tensor images = torch::rand({3, 4, 32, 32});
  const torch::Tensor together = encoder->forward(images);
  for (int64_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(
        torch::allclose(together[i], encoder->forward(images.slice(0, i, i + 1))[0], 1e-4, 1e-5));
  }
  // In training it does not: it normalises by the batch, and remembers.
  const auto remembered = [&] { return running_statistics(*encoder)[0].tensor.clone(); };
  const torch::Tensor before = remembered();
  encoder->train();
  EXPECT_FALSE(torch::allclose(together, encoder->forward(images), 1e-4, 1e-5));
  EXPECT_FALSE(torch::equal(before, remembered()));
}

TEST(ResidualEncoder, BeginsWithTheSameAnswerToEveryImage) {
  const Encoder encoder = new_encoder(untrained_residual(32, 4, 1));
  EXPECT_TRUE(torch::equal(encoder->forward(torch::rand({2, 4, 32, 32})), torch::zeros({2, 9})));
}

TEST(Encoder, RefusesWhatItDoesNotKnow) {
  for (const uint32_t resolution : {0U, 8U, 48U, 100U, 512U, 1U << 31}) {
    expect_error(ErrorKind::kInvalidInput, {"resolution is"},
                 [&] { new_encoder(untrained(resolution, 16)); });
  }
  expect_error(ErrorKind::kInvalidInput, {"base_channels is 0"},
               [] { new_encoder(untrained(64, 0)); });
  expect_error(ErrorKind::kInvalidInput, {"base_channels is 4000000000"},
               [] { new_encoder(untrained(64, 4000000000)); });
  v1::Model model = untrained(64, 16);
  model.clear_architecture();
  expect_error(ErrorKind::kInvalidInput, {"architecture"}, [&] { new_encoder(model); });
  model = untrained(64, 16);
  model.clear_output();
  expect_error(ErrorKind::kInvalidInput, {"output distribution"}, [&] { new_encoder(model); });
  model = untrained(64, 16);
  model.set_input(static_cast<v1::NetworkInput>(77));
  expect_error(ErrorKind::kInvalidInput, {"input"}, [&] { new_encoder(model); });
  for (const auto& [base, blocks, message] : {std::tuple{3U, 1U, "base_channels is 3"},
                                              {4000000000U, 1U, "base_channels is 4000000000"},
                                              {32U, 0U, "blocks is 0"},
                                              {32U, 4000000000U, "blocks is 4000000000"}}) {
    expect_error(ErrorKind::kInvalidInput, {message}, [base = base, blocks = blocks] {
      new_encoder(untrained_residual(64, base, blocks));
    });
  }
}

TEST(Weights, SurviveARoundTrip) {
  const v1::Model model = small_model();
  const Encoder a = load_encoder(model), b = load_encoder(model);
  const torch::Tensor input = torch::rand({1, 2, 16, 16});
  EXPECT_TRUE(torch::equal(a->forward(input), b->forward(input)));
  torch::manual_seed(1);
  const Encoder initial = new_encoder(model);
  initial->eval();  // while training, convolutions may sum in another order
  EXPECT_TRUE(torch::equal(a->forward(input), initial->forward(input)));
}

// What batch normalisation remembers is as much a part of the network as what is learned.
TEST(Weights, HaveTheRunningStatisticsAmongThem) {
  v1::Model model = residual_model();
  const torch::Tensor input = torch::rand({1, 4, 32, 32});
  const Encoder original = load_encoder(model);
  original->train();
  original->forward(torch::rand({8, 4, 32, 32}));
  original->eval();
  const torch::Tensor expected = original->forward(input);
  EXPECT_FALSE(torch::equal(expected, load_encoder(model)->forward(input)));
  store_weights(*original, model);
  EXPECT_TRUE(torch::equal(expected, load_encoder(model)->forward(input)));
}

TEST(Weights, ThatDoNotFitAreRefusedWithTheReason) {
  struct Row {
    std::vector<std::string> message;
    std::function<void(v1::Model&)> spoil;
  };
  const Row rows[] = {
      {{"convolutions.0.weight", "[2, 2, 3, 3]", "[3, 2, 3, 3]", "if another version wrote it",
        "itn train"},
       [](v1::Model& m) {
         m.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(3);
       }},
      {{"there are 0 tensors; there must be 10"}, [](v1::Model& m) { m.clear_weights(); }},
      {{"there are 9 tensors"}, [](v1::Model& m) { m.mutable_weights()->RemoveLast(); }},
      {{"\"tail.bias\" where \"head.bias\" should be"},
       [](v1::Model& m) { m.mutable_weights(9)->set_name("tail.bias"); }},
      {{"\"??[2J\" where"}, [](v1::Model& m) { m.mutable_weights(9)->set_name("\033\n[2J"); }},
      {{"head.bias", "type"},
       [](v1::Model& m) { m.mutable_weights(9)->set_type(v1::Tensor::TYPE_UNSPECIFIED); }},
      {{"head.bias has 11 bytes; its shape needs 12"},
       [](v1::Model& m) { m.mutable_weights(9)->mutable_data()->pop_back(); }},
      {{"head.bias has 16 bytes"},
       [](v1::Model& m) { m.mutable_weights(9)->set_data("16 byte archive!"); }},
      {{"head.bias holds nan as its value number 1"},
       [](v1::Model& m) {
         m.mutable_weights(9)->mutable_data()->replace(4, 4, std::string("\0\0\xc0\x7f", 4));
       }},
      {{"head.bias holds inf"},
       [](v1::Model& m) {
         m.mutable_weights(9)->mutable_data()->replace(4, 4, std::string("\0\0\x80\x7f", 4));
       }},
      {{"image_scale is nan"}, [](v1::Model& m) { m.set_image_scale(NAN); }},
      {{"model.name"}, [](v1::Model& m) { m.set_name("\033[31mred"); }},
      {{"model.name"}, [](v1::Model& m) { m.set_name(std::string(101, 'a')); }},
  };
  for (const Row& row : rows) {
    v1::Model model = small_model();
    row.spoil(model);
    expect_error(ErrorKind::kInvalidInput, row.message, [&] { load_encoder(model); });
  }
}

// 2.4 GB of weights would be the network's; a message of some bytes says so.
TEST(Weights, AreComparedBeforeTheNetworkIsAllocated) {
  v1::Model model = small_model();
  model.set_resolution(256);
  model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(64);
  const AddressSpaceLimit limit(size_t{64} << 20);
  expect_error(ErrorKind::kInvalidInput, {"there are 10 tensors; there must be 18"},
               [&] { load_encoder(model); });
}

}  // namespace
}  // namespace itn
