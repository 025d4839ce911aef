#include "common/learning/encoder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <mutex>

#include <ATen/Parallel.h>
#include <fmt/format.h>

#include "common/error.h"
#include "common/learning/architectures.h"
#include "common/learning/gaussian.h"
#include "common/learning/network_input.h"

namespace itn {
namespace {

void validate_resolution(uint32_t resolution) {
  if (resolution < 16 || resolution > 256 || !std::has_single_bit(resolution)) {
    throw invalid_input(
        fmt::format("the resolution is {}; the network takes 16, 32, 64, 128 or 256", resolution));
  }
}

// The name goes to terminals and logs, from files that may be anybody's.
void validate_name(const char* what, const std::string& name) {
  constexpr size_t kMaxLength = 100;
  if (name.size() > kMaxLength ||
      !std::ranges::all_of(name, [](char c) { return c >= ' ' && c <= '~'; })) {
    throw invalid_input(fmt::format("{} must be up to 100 printable ASCII characters", what));
  }
}

constexpr const char* kLastLayer = "head.weight";  // of every architecture

// Calls `use` with the model's architecture and what it is between.
template <typename Use>
auto with_architecture(const v1::Model& model, const Use& use) {
  validate_resolution(model.resolution());
  const EncoderShape ends{model.resolution(), input_channels(model), output_count(model)};
  switch (model.architecture().kind_case()) {
    case v1::Architecture::kPlainConvolutions:
      return use(model.architecture().plain_convolutions(), ends);
    case v1::Architecture::kResidualConvolutions:
      return use(model.architecture().residual_convolutions(), ends);
    default:
      throw invalid_input("the model's architecture is not one that this version of itn knows");
  }
}

}  // namespace

int64_t output_count(const v1::Model& model) {
  const size_t coordinates = coordinate_count(channels_of(model));
  switch (model.output()) {
    case v1::POINT: return static_cast<int64_t>(coordinates);
    case v1::GAUSSIAN: {
      const uint32_t components = std::max(1U, model.components());
      require(
          components <= kMaxComponents,
          fmt::format("model.components is {}; it must be at most {}", components, kMaxComponents));
      return static_cast<int64_t>(mixture_outputs(coordinates, components));
    }
    default:
      throw invalid_input(
          "the model's output distribution is not one that this version of itn knows");
  }
}

std::vector<TensorShape> tensor_shapes(const v1::Model& model) {
  return with_architecture(model, [](const auto& architecture, const EncoderShape& ends) {
    return tensor_shapes(architecture, ends);
  });
}

int64_t embedding_size(const v1::Model& model) {
  const std::vector<TensorShape> shapes = tensor_shapes(model);
  return std::ranges::find(shapes, kLastLayer, &TensorShape::name)->shape.at(1);
}

Encoder new_encoder(const v1::Model& model) {
  return with_architecture(model, [](const auto& architecture, const EncoderShape& ends) {
    return new_encoder(architecture, ends);
  });
}

Encoder load_encoder(const v1::Model& model) {
  validate_name("model.name", model.name());
  validate_name("model.version", model.version());
  if (!(model.image_scale() > 0) || !std::isfinite(model.image_scale())) {
    throw invalid_input(fmt::format("model.image_scale is {}; it must be positive and finite",
                                    model.image_scale()));
  }
  const std::vector<TensorShape> shapes = tensor_shapes(model);
  // The checksum of the file was right: what does not fit was written so, by another program.
  try {
    validate_shapes(model.weights(), shapes);
  } catch (const Error& error) {
    throw invalid_input(fmt::format(
        "the weights are not those of the network that this version of itn builds from the model's "
        "description ({}); if another version wrote it, use that one, or train the network again: "
        "itn train",
        error.what()));
  }
  validate(model.weights(), shapes);
  Encoder encoder = new_encoder(model);
  const torch::NoGradGuard no_gradient;
  int index = 0;
  for (NamedTensor& named : all_tensors(*encoder)) {
    copy_values(model.weights(index++), named.tensor);
  }
  encoder->eval();
  return encoder;
}

std::vector<NamedTensor> all_tensors(const EncoderNetwork& encoder) {
  std::vector<NamedTensor> tensors;
  for (const auto& parameter : encoder.named_parameters()) {
    tensors.push_back({parameter.key(), parameter.value()});
  }
  for (NamedTensor& statistics : running_statistics(encoder)) {
    tensors.push_back(std::move(statistics));
  }
  return tensors;
}

std::vector<NamedTensor> running_statistics(const EncoderNetwork& encoder) {
  std::vector<NamedTensor> tensors;
  for (const auto& buffer : encoder.named_buffers()) {
    if (buffer.value().is_floating_point()) {  // torch also counts batches, and does not look at it
      tensors.push_back({buffer.key(), buffer.value()});
    }
  }
  return tensors;
}

void store_weights(const EncoderNetwork& encoder, v1::Model& model) {
  store_weights(all_tensors(encoder), model);
}

void store_weights(std::span<const NamedTensor> tensors, v1::Model& model) {
  model.clear_weights();
  for (const NamedTensor& named : tensors) {
    *model.add_weights() = to_proto(named.name, named.tensor);
  }
}

void set_torch_threads(int threads) {
  at::set_num_threads(threads);
  // Torch accepts this once in a process.
  static std::once_flag once;
  std::call_once(once, [] { at::set_num_interop_threads(1); });
}

}  // namespace itn
