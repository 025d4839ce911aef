// A residual network (He et al., "Deep Residual Learning for Image Recognition", CVPR 2016) for
// small images of one object on black: it pools over the object alone.
//
//   stem      5x5 convolution, stride 2
//   stages    of blocks of two 3x3 convolutions beside a shortcut; the first of each has stride 2
//   pooling   mean and maximum over the object, and statistics of the input
//   head      two fully connected layers, a SiLU between them (Elfwing et al., "Sigmoid-weighted
//             linear units for neural network function approximation", 2018)
//
// Every convolution is followed by batch normalisation, whose running statistics are part of the
// model: an answer in prediction depends on no other image.
#include <algorithm>

#include <fmt/format.h>
#include <torch/nn.h>

#include "common/error.h"
#include "common/learning/architectures.h"
#include "common/learning/batch_invariant_layers.h"

namespace itn {
namespace {

namespace nn = torch::nn;

constexpr int64_t kStemKernel = 5;
constexpr uint32_t kLastSize = 4;     // of the last stage's feature maps, in pixels
constexpr int64_t kLastWidening = 8;  // of the base channels, at most
constexpr int64_t kEmbedding = 128;   // what the answer is read off

struct BlockSize {
  int64_t in, out, stride;
};

struct NetworkSize {
  int64_t input_channels, stem;
  std::vector<std::vector<BlockSize>> stages;
  int64_t outputs;

  // Mean and maximum of each channel; mean and deviation of each plane of the input but the mask,
  // and the object's area.
  int64_t pooled() const { return 2 * stages.back().back().out + 2 * (input_channels - 1) + 1; }
};

NetworkSize size_of(const v1::ResidualConvolutions& architecture, const EncoderShape& ends) {
  const auto require = [](const char* name, uint32_t value, uint32_t min, uint32_t max) {
    if (value < min || value > max) {
      throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", name, value, min, max));
    }
  };
  require("base_channels", architecture.base_channels(), 4, 128);
  require("blocks", architecture.blocks(), 1, 4);
  const int64_t base = architecture.base_channels();
  NetworkSize size{ends.input_channels, base, {}, ends.outputs};
  int64_t in = base, widening = 2;
  for (uint32_t pixels = ends.resolution / 2; pixels > kLastSize; pixels /= 2) {
    const int64_t out = base * std::min(widening, kLastWidening);
    std::vector<BlockSize> stage{{in, out, 2}};
    stage.resize(architecture.blocks(), {out, out, 1});
    size.stages.push_back(std::move(stage));
    in = out;
    widening *= 2;
  }
  return size;
}

// Without a bias, which the normalisation that follows would take away again.
nn::Conv2d convolution(int64_t in, int64_t out, int64_t kernel, int64_t stride) {
  nn::Conv2d layer(
      nn::Conv2dOptions(in, out, kernel).stride(stride).padding((kernel - 1) / 2).bias(false));
  nn::init::kaiming_normal_(layer->weight, 0, torch::kFanIn, torch::kReLU);
  return layer;
}

// What a 1x1 convolution of that stride sees of batch x channels x height x width. The stride is
// not left to the convolution: oneDNN 2.6 writes beyond the gradient of such weights where there
// are fewer input channels, and they come last, than a vector has numbers (8, or 16 with AVX-512).
torch::Tensor subsampled(const torch::Tensor& x, int64_t stride) {
  return x.slice(2, 0, c10::nullopt, stride)
      .slice(3, 0, c10::nullopt, stride)
      .contiguous(torch::MemoryFormat::ChannelsLast);
}

class ResidualBlock final : public nn::Module {
 public:
  explicit ResidualBlock(const BlockSize& size)
      : stride_(size.stride),
        conv1_(register_module("conv1", convolution(size.in, size.out, 3, size.stride))),
        norm1_(register_module("norm1", nn::BatchNorm2d(size.out))),
        conv2_(register_module("conv2", convolution(size.out, size.out, 3, 1))),
        norm2_(register_module("norm2", nn::BatchNorm2d(size.out))) {
    // Each block begins as its shortcut (Goyal et al. 2017, Sec. 5.1).
    nn::init::zeros_(norm2_->weight);
    if (has_shortcut(size)) {
      shortcut_ = register_module("shortcut", convolution(size.in, size.out, 1, 1));
      shortcut_norm_ = register_module("shortcut_norm", nn::BatchNorm2d(size.out));
    }
  }

  torch::Tensor forward(const torch::Tensor& x) {
    torch::Tensor y = norm1_->forward(batch_invariant_conv2d(*conv1_, x)).relu_();
    y = norm2_->forward(batch_invariant_conv2d(*conv2_, y));
    return (y + (shortcut_ ? shortcut_of(x) : x)).relu_();
  }

  static bool has_shortcut(const BlockSize& size) { return size.stride != 1; }

 private:
  torch::Tensor shortcut_of(const torch::Tensor& x) {
    return shortcut_norm_->forward(batch_invariant_conv2d(*shortcut_, subsampled(x, stride_)));
  }

  int64_t stride_;
  nn::Conv2d conv1_;
  nn::BatchNorm2d norm1_;
  nn::Conv2d conv2_;
  nn::BatchNorm2d norm2_;
  nn::Conv2d shortcut_{nullptr};
  nn::BatchNorm2d shortcut_norm_{nullptr};
};

// Mean over the object: batch x channels x height x width -> batch x channels. `mask`: batch x 1 x
// height x width, its sum never 0 where there is an object.
torch::Tensor masked_mean(const torch::Tensor& x, const torch::Tensor& mask) {
  constexpr double kNoObject = 1e-6;
  return sum_of_planes(x * mask) / sum_of_planes(mask).clamp_min(kNoObject);
}

// Mean and deviation of the planes over the object, and the part of the image that it takes.
torch::Tensor input_statistics(const torch::Tensor& planes, const torch::Tensor& mask) {
  constexpr double kSmallestVariance = 1e-6;
  const torch::Tensor mean = masked_mean(planes, mask);
  const torch::Tensor variance =
      masked_mean((planes - mean.unsqueeze(2).unsqueeze(3)).square(), mask);
  const torch::Tensor area = sum_of_planes(mask) / (mask.size(2) * mask.size(3));
  return torch::cat({mean, variance.clamp_min(kSmallestVariance).sqrt(), area}, 1);
}

class ResidualConvolutionNetwork final : public EncoderNetwork {
 public:
  explicit ResidualConvolutionNetwork(const NetworkSize& size)
      : stem_(register_module("stem", convolution(size.input_channels, size.stem, kStemKernel, 2))),
        stem_norm_(register_module("stem_norm", nn::BatchNorm2d(size.stem))),
        embedding_(register_module("embedding", nn::Linear(size.pooled(), kEmbedding))),
        head_(register_module("head", nn::Linear(kEmbedding, size.outputs))) {
    for (const std::vector<BlockSize>& stage : size.stages) {
      for (const BlockSize& block : stage) {
        blocks_->push_back(std::make_shared<ResidualBlock>(block));
      }
    }
    register_module("blocks", blocks_);
    // The first answer to every image is the mean of the truth, or the Gaussian of all.
    nn::init::zeros_(head_->weight);
    nn::init::zeros_(head_->bias);
  }

  torch::Tensor embed(const torch::Tensor& input) override {
    const int64_t planes = input.size(1) - 1;
    const torch::Tensor mask = input.slice(1, planes);
    // Channels last: all layers keep it, and are half again as fast with it.
    torch::Tensor x = input.contiguous(torch::MemoryFormat::ChannelsLast);
    x = stem_norm_->forward(batch_invariant_conv2d(*stem_, x)).relu_();
    for (const auto& block : *blocks_) x = block->as<ResidualBlock>()->forward(x);
    // Pool over the cells that see the object.
    const torch::Tensor cells = torch::adaptive_avg_pool2d(mask, {x.size(2), x.size(3)});
    const torch::Tensor maximum = (x * (cells > 0)).amax({2, 3});
    const torch::Tensor pooled = torch::cat(
        {masked_mean(x, cells), maximum, input_statistics(input.slice(1, 0, planes), mask)}, 1);
    // A rectifier would leave 18 of the 128 alive: the first steps of a fast optimizer are large.
    return torch::silu(batch_invariant_linear(*embedding_, pooled));
  }

  torch::Tensor answer(const torch::Tensor& embedding) override {
    return batch_invariant_linear(*head_, embedding);
  }

 private:
  nn::Conv2d stem_;
  nn::BatchNorm2d stem_norm_;
  nn::Linear embedding_, head_;
  nn::ModuleList blocks_;
};

}  // namespace

std::vector<TensorShape> tensor_shapes(const v1::ResidualConvolutions& architecture,
                                       const EncoderShape& ends) {
  const NetworkSize size = size_of(architecture, ends);
  std::vector<TensorShape> learned, running;
  const auto add_convolution = [&](const std::string& name, int64_t in, int64_t out,
                                   int64_t kernel) {
    learned.push_back({name + ".weight", {out, in, kernel, kernel}});
  };
  const auto add_norm = [&](const std::string& name, int64_t channels) {
    learned.push_back({name + ".weight", {channels}});
    learned.push_back({name + ".bias", {channels}});
    running.push_back({name + ".running_mean", {channels}});
    running.push_back({name + ".running_var", {channels}});
  };
  const auto add_linear = [&](const std::string& name, int64_t in, int64_t out) {
    learned.push_back({name + ".weight", {out, in}});
    learned.push_back({name + ".bias", {out}});
  };
  add_convolution("stem", size.input_channels, size.stem, kStemKernel);
  add_norm("stem_norm", size.stem);
  add_linear("embedding", size.pooled(), kEmbedding);
  add_linear("head", kEmbedding, size.outputs);
  int index = 0;
  for (const std::vector<BlockSize>& stage : size.stages) {
    for (const BlockSize& block : stage) {
      const std::string name = fmt::format("blocks.{}.", index++);
      add_convolution(name + "conv1", block.in, block.out, 3);
      add_norm(name + "norm1", block.out);
      add_convolution(name + "conv2", block.out, block.out, 3);
      add_norm(name + "norm2", block.out);
      if (ResidualBlock::has_shortcut(block)) {
        add_convolution(name + "shortcut", block.in, block.out, 1);
        add_norm(name + "shortcut_norm", block.out);
      }
    }
  }
  learned.insert(learned.end(), running.begin(), running.end());
  return learned;
}

Encoder new_encoder(const v1::ResidualConvolutions& architecture, const EncoderShape& ends) {
  return std::make_shared<ResidualConvolutionNetwork>(size_of(architecture, ends));
}

}  // namespace itn
