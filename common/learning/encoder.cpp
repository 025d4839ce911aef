#include "common/learning/encoder.h"

#include <algorithm>
#include <bit>
#include <mutex>
#include <sstream>

#include <fmt/format.h>

#include "common/error.h"
#include "common/learning/weight_map.h"

namespace itn {
namespace {

void validate_architecture(int resolution, int base_channels) {
  if (resolution < 16 || resolution > 256 ||
      !std::has_single_bit(static_cast<unsigned>(resolution))) {
    throw invalid_input(
        fmt::format("the resolution is {}; the network takes 16, 32, 64, 128 or 256", resolution));
  }
  if (base_channels < 1 || base_channels > 64) {
    throw invalid_input(fmt::format("base_channels is {}; it must be in [1, 64]", base_channels));
  }
}

}  // namespace

EncoderImpl::EncoderImpl(int resolution, int base_channels) {
  validate_architecture(resolution, base_channels);
  namespace nn = torch::nn;
  int channels = 2;
  int next = base_channels;
  for (int size = resolution; size > 1; size /= 2) {
    nn::Conv2d convolution(nn::Conv2dOptions(channels, next, 3).padding(1));
    // He et al., ICCV 2015: keeps the signal's size through the ReLUs. (The default lets it decay
    // so far over seven blocks that training starts with the biases alone.)
    nn::init::kaiming_normal_(convolution->weight, 0, torch::kFanIn, torch::kReLU);
    nn::init::zeros_(convolution->bias);
    convolutions_->push_back(convolution);
    convolutions_->push_back(nn::ReLU());
    convolutions_->push_back(nn::MaxPool2d(nn::MaxPool2dOptions(2)));
    channels = next;
    next *= 2;
  }
  register_module("convolutions", convolutions_);
  head_ = register_module("head", nn::Linear(channels, 3));
}

torch::Tensor EncoderImpl::forward(const torch::Tensor& input) {
  return head_->forward(convolutions_->forward(input).flatten(1));
}

torch::Tensor encoder_input(int resolution, std::span<const float> luminance,
                            std::span<const float> mask, double image_scale) {
  torch::Tensor input = torch::empty({2, resolution, resolution});
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

std::string serialize_weights(const Encoder& encoder) {
  std::ostringstream stream;
  torch::save(encoder, stream);
  return std::move(stream).str();
}

Encoder load_encoder(const v1::Model& model) {
  Encoder encoder(static_cast<int>(model.resolution()), static_cast<int>(model.base_channels()));
  std::istringstream stream(model.weights());
  try {
    torch::load(encoder, stream);
  } catch (const std::exception& error) {
    throw Error(ErrorKind::kDataLoss,
                fmt::format("the model's weights cannot be read: {}", error.what()));
  }
  // Loading puts tensors of whatever shape the archive holds in the place of ours.
  const Encoder expected(static_cast<int>(model.resolution()),
                         static_cast<int>(model.base_channels()));
  const auto loaded = encoder->parameters();
  const auto wanted = expected->parameters();
  for (size_t i = 0; i < wanted.size(); ++i) {
    if (loaded[i].sizes() != wanted[i].sizes()) {
      throw invalid_input("the model's weights are of another network than it says");
    }
  }
  return encoder;
}

}  // namespace itn
