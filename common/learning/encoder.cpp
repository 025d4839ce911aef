#include "common/learning/encoder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <mutex>

#include <fmt/format.h>

#include "common/error.h"
#include "common/learning/weight_map.h"

namespace itn {
namespace {

constexpr int64_t kInputChannels = 2;  // encoder_input()

void validate_resolution(uint32_t resolution) {
  if (resolution < 16 || resolution > 256 || !std::has_single_bit(resolution)) {
    throw invalid_input(
        fmt::format("the resolution is {}; the network takes 16, 32, 64, 128 or 256", resolution));
  }
}

// The name goes to terminals and logs, from files that may be anybody's.
void validate_name(const std::string& name) {
  constexpr size_t kMaxLength = 100;
  if (name.size() > kMaxLength ||
      !std::ranges::all_of(name, [](char c) { return c >= ' ' && c <= '~'; })) {
    throw invalid_input("model.name must be up to 100 printable ASCII characters");
  }
}

// --- PlainConvolutions ---

// Of Che et al., ICCP 2020: resolution 128, base channels 16: seven blocks, 16 .. 1024 channels.
struct Block {
  int64_t in, out;  // channels
};

std::vector<Block> blocks_of(const v1::PlainConvolutions& architecture, uint32_t resolution) {
  if (architecture.base_channels() < 1 || architecture.base_channels() > 64) {
    throw invalid_input(
        fmt::format("base_channels is {}; it must be in [1, 64]", architecture.base_channels()));
  }
  std::vector<Block> blocks;
  Block block{kInputChannels, architecture.base_channels()};
  for (uint32_t size = resolution; size > 1; size /= 2) {
    blocks.push_back(block);
    block = {block.out, 2 * block.out};
  }
  return blocks;
}

class PlainConvolutions final : public EncoderNetwork {
 public:
  PlainConvolutions(const std::vector<Block>& blocks, int64_t outputs) {
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

  torch::Tensor forward(const torch::Tensor& input) override {
    return head_->forward(convolutions_->forward(input).flatten(1));
  }

  static std::vector<TensorShape> shapes(const std::vector<Block>& blocks, int64_t outputs) {
    constexpr size_t kLayersPerBlock = 3;
    std::vector<TensorShape> result;
    for (size_t i = 0; i < blocks.size(); ++i) {
      const std::string name = fmt::format("convolutions.{}", i * kLayersPerBlock);
      result.push_back({name + ".weight", {blocks[i].out, blocks[i].in, 3, 3}});
      result.push_back({name + ".bias", {blocks[i].out}});
    }
    result.push_back({"head.weight", {outputs, blocks.back().out}});
    result.push_back({"head.bias", {outputs}});
    return result;
  }

 private:
  torch::nn::Sequential convolutions_;
  torch::nn::Linear head_{nullptr};
};

// Calls `use` with what the model's network is made of.
template <typename Use>
auto with_architecture(const v1::Model& model, const Use& use) {
  validate_resolution(model.resolution());
  switch (model.architecture().kind_case()) {
    case v1::Architecture::kPlainConvolutions:
      return use(blocks_of(model.architecture().plain_convolutions(), model.resolution()),
                 output_count(model));
    default:
      throw invalid_input("the model's architecture is not one that this version of itn knows");
  }
}

}  // namespace

int64_t output_count(const v1::Model& model) {
  if (model.output() != v1::POINT) {
    throw invalid_input(
        "the model's output distribution is not one that this version of itn knows");
  }
  return 3;
}

std::vector<TensorShape> tensor_shapes(const v1::Model& model) {
  return with_architecture(model, &PlainConvolutions::shapes);
}

Encoder new_encoder(const v1::Model& model) {
  return with_architecture(model, [](const std::vector<Block>& blocks, int64_t outputs) -> Encoder {
    return std::make_shared<PlainConvolutions>(blocks, outputs);
  });
}

Encoder load_encoder(const v1::Model& model) {
  validate_name(model.name());
  if (!(model.image_scale() > 0) || !std::isfinite(model.image_scale())) {
    throw invalid_input(fmt::format("model.image_scale is {}; it must be positive and finite",
                                    model.image_scale()));
  }
  const std::vector<TensorShape> shapes = tensor_shapes(model);
  try {
    validate(model.weights(), shapes);
  } catch (const Error& error) {
    throw invalid_input(fmt::format(
        "the weights are not those of the network that the model describes: {}", error.what()));
  }
  Encoder encoder = new_encoder(model);
  const torch::NoGradGuard no_gradient;
  int index = 0;
  for (torch::Tensor& parameter : encoder->parameters()) {
    copy_values(model.weights(index++), parameter);
  }
  return encoder;
}

void store_weights(const EncoderNetwork& encoder, v1::Model& model) {
  model.clear_weights();
  for (const auto& parameter : encoder.named_parameters()) {
    *model.add_weights() = to_proto(parameter.key(), parameter.value());
  }
}

torch::Tensor encoder_input(int resolution, std::span<const float> luminance,
                            std::span<const float> mask, double image_scale) {
  torch::Tensor input = torch::empty({kInputChannels, resolution, resolution});
  float* values = input.data_ptr<float>();
  const auto scale = static_cast<float>(image_scale);
  values = std::transform(luminance.begin(), luminance.end(), mask.begin(), values,
                          [scale](float y, float m) { return scale * y * m; });
  std::ranges::copy(weight_map(resolution, resolution, luminance, mask), values);
  return input;
}

void set_torch_threads(int threads) {
  at::set_num_threads(threads);
  // Torch accepts this once in a process.
  static std::once_flag once;
  std::call_once(once, [] { at::set_num_interop_threads(1); });
}

}  // namespace itn
