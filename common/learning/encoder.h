// The encoder network of Che et al., ICCP 2020: from an image to standardised material coordinates.
#pragma once

#include <span>
#include <string>

#include <torch/torch.h>

#include "itn/v1/experiment.pb.h"

namespace itn {

// Blocks of a 3x3 convolution (stride 1, padding 1), ReLU and 2x2 max-pooling, as many as take the
// resolution to 1; channels double from `base_channels`. Then one fully connected layer to 3.
// Of the paper: resolution 128, base channels 16: seven blocks, 16 .. 1024 channels.
class EncoderImpl : public torch::nn::Module {
 public:
  // Throws Error (invalid input) unless the resolution is a power of two in [16, 256] and base
  // channels are in [1, 64].
  EncoderImpl(int resolution, int base_channels);

  // batch x 2 x resolution x resolution -> batch x 3.
  torch::Tensor forward(const torch::Tensor& input);

 private:
  torch::nn::Sequential convolutions_;
  torch::nn::Linear head_{nullptr};
};
TORCH_MODULE(Encoder);

// 2 x resolution x resolution float: image_scale * luminance * mask, and the weight map.
torch::Tensor encoder_input(int resolution, std::span<const float> luminance,
                            std::span<const float> mask, double image_scale);

// How many threads torch computes with; to be called before any torch operation. Results depend on
// it in the last bits (sums are split over the threads).
void set_torch_threads(int threads);

// The weights as a LibTorch archive, and back. load_encoder throws Error: kDataLoss if the archive
// cannot be read, kInvalidInput if it is of another network than the model says.
std::string serialize_weights(const Encoder& encoder);
Encoder load_encoder(const v1::Model& model);

}  // namespace itn
