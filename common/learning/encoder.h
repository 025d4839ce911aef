// Encoder networks: from an image to standardised material coordinates.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include <torch/torch.h>

#include "common/learning/tensor_data.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// A network of any architecture (v1::Architecture).
class EncoderNetwork : public torch::nn::Module {
 public:
  // batch x 2 x resolution x resolution -> batch x output_count(model).
  virtual torch::Tensor forward(const torch::Tensor& input) = 0;
};
using Encoder = std::shared_ptr<EncoderNetwork>;

// Numbers that a network of this output distribution answers with for each image.
int64_t output_count(const v1::Model& model);

// Names and shapes of a network's tensors, in their order; nothing is allocated for it. Throws
// Error (invalid input) unless the model has a known architecture and output distribution, its
// resolution is a power of two in [16, 256], and base channels are in [1, 64].
std::vector<TensorShape> tensor_shapes(const v1::Model& model);

// With random weights, by torch's generator. Throws as tensor_shapes().
Encoder new_encoder(const v1::Model& model);

// With the model's weights. Throws Error (invalid input) that says what is wrong: with the name,
// the numbers, the architecture or the weights.
Encoder load_encoder(const v1::Model& model);

// Puts the network's weights into the model.
void store_weights(const EncoderNetwork& encoder, v1::Model& model);

// 2 x resolution x resolution float: image_scale * luminance * mask, and the weight map.
torch::Tensor encoder_input(int resolution, std::span<const float> luminance,
                            std::span<const float> mask, double image_scale);

// How many threads torch computes with; to be called before any torch operation. Results depend on
// it in the last bits (sums are split over the threads).
void set_torch_threads(int threads);

}  // namespace itn
