// Encoder networks: from an image to numbers that stand for its material.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <torch/nn/module.h>
#include <torch/types.h>

#include "common/learning/tensor_data.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// A network of any architecture (v1::Architecture). In training mode (train(), eval()) it may
// normalise by the statistics of the batch, and then updates its running ones.
class EncoderNetwork : public torch::nn::Module {
 public:
  // batch x channels x resolution x resolution, as network_input() -> batch x features: what the
  // network's last layer sees of each image. Neither this nor answer() of an image depends on the
  // others of the batch, bit for bit, but in training mode.
  virtual torch::Tensor embed(const torch::Tensor& input) = 0;
  // That layer: batch x features -> batch x output_count(model).
  virtual torch::Tensor answer(const torch::Tensor& embedding) = 0;

  torch::Tensor forward(const torch::Tensor& input) { return answer(embed(input)); }
};
using Encoder = std::shared_ptr<EncoderNetwork>;

// Numbers that a network of this output distribution answers with for each image.
int64_t output_count(const v1::Model& model);

// Names and shapes of a network's tensors, in the order of all_tensors(); nothing is allocated for
// it. Throws Error (invalid input) unless the model has a known architecture, input and output
// distribution, its resolution is a power of two in [16, 256], and the architecture's numbers are
// in their ranges.
std::vector<TensorShape> tensor_shapes(const v1::Model& model);

// Features that the model's network gives its last layer: of EncoderNetwork::embed(). Throws as
// tensor_shapes().
int64_t embedding_size(const v1::Model& model);

// With random weights, by torch's generator. Throws as tensor_shapes().
Encoder new_encoder(const v1::Model& model);

// With the model's weights, ready to predict. Throws Error (invalid input) that says what is wrong:
// with the name, the numbers, the architecture or the weights.
Encoder load_encoder(const v1::Model& model);

// Everything that makes the network answer as it does: its parameters, then its running statistics.
// They are the network's own: who writes into them changes it.
struct NamedTensor {
  std::string name;
  torch::Tensor tensor;
};
std::vector<NamedTensor> all_tensors(const EncoderNetwork& encoder);

// The last of them: what a forward pass in training mode changes.
std::vector<NamedTensor> running_statistics(const EncoderNetwork& encoder);

// Puts the network's tensors into the model, or those that stand for them, as all_tensors().
void store_weights(const EncoderNetwork& encoder, v1::Model& model);
void store_weights(std::span<const NamedTensor> tensors, v1::Model& model);

// How many threads torch computes with; to be called before any torch operation. Results depend on
// it in the last bits (sums are split over the threads).
void set_torch_threads(int threads);

}  // namespace itn
