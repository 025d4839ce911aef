// The encoder of Che et al., ICCP 2020: at resolution 128 with 16 base channels seven blocks of a
// convolution, ReLU and pooling, of 16 to 1024 channels.
#include <fmt/format.h>
#include <torch/nn.h>

#include "common/error.h"
#include "common/learning/architectures.h"
#include "common/learning/batch_invariant_layers.h"

namespace itn {
namespace {

struct Block {
  int64_t in, out;  // channels
};

std::vector<Block> blocks_of(const v1::PlainConvolutions& architecture, const EncoderShape& ends) {
  if (architecture.base_channels() < 1 || architecture.base_channels() > 64) {
    throw invalid_input(
        fmt::format("base_channels is {}; it must be in [1, 64]", architecture.base_channels()));
  }
  std::vector<Block> blocks;
  Block block{ends.input_channels, architecture.base_channels()};
  for (uint32_t size = ends.resolution; size > 1; size /= 2) {
    blocks.push_back(block);
    block = {block.out, 2 * block.out};
  }
  return blocks;
}

class PlainConvolutionNetwork final : public EncoderNetwork {
 public:
  PlainConvolutionNetwork(const std::vector<Block>& blocks, int64_t outputs) {
    namespace nn = torch::nn;
    for (const Block& block : blocks) {
      nn::Conv2d convolution(nn::Conv2dOptions(block.in, block.out, 3).padding(1));
      // He et al., ICCV 2015: keeps the signal's size through the ReLUs. (The default lets it decay
      // so far over seven blocks that training starts with the biases alone.)
      nn::init::kaiming_normal_(convolution->weight, 0, torch::kFanIn, torch::kReLU);
      nn::init::zeros_(convolution->bias);
      convolutions_->push_back(convolution);
      convolutions_->push_back(nn::ReLU());
      convolutions_->push_back(nn::MaxPool2d(nn::MaxPool2dOptions(2)));
    }
    register_module("convolutions", convolutions_);
    head_ = register_module("head", nn::Linear(blocks.back().out, outputs));
  }

  torch::Tensor embed(const torch::Tensor& input) override {
    torch::Tensor x = input;
    for (torch::nn::AnyModule& layer : *convolutions_) {
      const auto convolution = std::dynamic_pointer_cast<torch::nn::Conv2dImpl>(layer.ptr());
      x = convolution ? batch_invariant_conv2d(*convolution, x) : layer.forward(x);
    }
    return x.flatten(1);
  }
  torch::Tensor answer(const torch::Tensor& embedding) override {
    return batch_invariant_linear(*head_, embedding);
  }

 private:
  torch::nn::Sequential convolutions_;
  torch::nn::Linear head_{nullptr};
};

}  // namespace

std::vector<TensorShape> tensor_shapes(const v1::PlainConvolutions& architecture,
                                       const EncoderShape& ends) {
  constexpr size_t kLayersPerBlock = 3;
  const std::vector<Block> blocks = blocks_of(architecture, ends);
  std::vector<TensorShape> shapes;
  for (size_t i = 0; i < blocks.size(); ++i) {
    const std::string name = fmt::format("convolutions.{}", i * kLayersPerBlock);
    shapes.push_back({name + ".weight", {blocks[i].out, blocks[i].in, 3, 3}});
    shapes.push_back({name + ".bias", {blocks[i].out}});
  }
  shapes.push_back({"head.weight", {ends.outputs, blocks.back().out}});
  shapes.push_back({"head.bias", {ends.outputs}});
  return shapes;
}

Encoder new_encoder(const v1::PlainConvolutions& architecture, const EncoderShape& ends) {
  return std::make_shared<PlainConvolutionNetwork>(blocks_of(architecture, ends), ends.outputs);
}

}  // namespace itn
