#include "common/learning/tensor_data.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/error.h"

namespace itn {
namespace {

static_assert(std::endian::native == std::endian::little, "a tensor's data are little-endian");

// A name comes from a file: what cannot be printed is left out of messages.
std::string printable(const std::string& name) {
  constexpr size_t kMaxLength = 60;
  std::string text = name.substr(0, kMaxLength);
  for (char& c : text) {
    if (c < ' ' || c > '~') c = '?';
  }
  return text;
}

void require_shape(const v1::Tensor& tensor, const TensorShape& expected) {
  if (tensor.name() != expected.name) {
    throw invalid_input(fmt::format("there is a tensor \"{}\" where \"{}\" should be",
                                    printable(tensor.name()), expected.name));
  }
  if (tensor.type() != v1::Tensor::FLOAT32) {
    throw invalid_input(fmt::format("the tensor {} is of type {}; it must be FLOAT32",
                                    expected.name, static_cast<int>(tensor.type())));
  }
  const bool same_shape = std::equal(
      tensor.shape().begin(), tensor.shape().end(), expected.shape.begin(), expected.shape.end(),
      [](uint64_t a, int64_t b) { return a == static_cast<uint64_t>(b); });
  if (!same_shape) {
    constexpr int kMaxDimensions = 8;
    throw invalid_input(fmt::format(
        "the tensor {} has the shape [{}]; it must be [{}]", expected.name,
        fmt::join(tensor.shape().begin(),
                  tensor.shape().begin() + std::min(tensor.shape_size(), kMaxDimensions), ", "),
        fmt::join(expected.shape, ", ")));
  }
  const size_t bytes = std::accumulate(expected.shape.begin(), expected.shape.end(), sizeof(float),
                                       std::multiplies<size_t>());
  if (tensor.data().size() != bytes) {
    throw invalid_input(fmt::format("the tensor {} has {} bytes; its shape needs {}", expected.name,
                                    tensor.data().size(), bytes));
  }
}

void require_finite(const v1::Tensor& tensor) {
  for (size_t begin = 0; begin < tensor.data().size(); begin += sizeof(float)) {
    float value = 0;
    std::memcpy(&value, tensor.data().data() + begin, sizeof value);
    if (!std::isfinite(value)) {
      throw invalid_input(fmt::format("the tensor {} holds {} as its value number {}",
                                      tensor.name(), value, begin / sizeof(float)));
    }
  }
}

}  // namespace

v1::Tensor to_proto(const std::string& name, const torch::Tensor& tensor) {
  const torch::Tensor values = tensor.detach().to(torch::kFloat32).contiguous();
  v1::Tensor proto;
  proto.set_name(name);
  proto.set_type(v1::Tensor::FLOAT32);
  for (const int64_t size : values.sizes()) proto.add_shape(static_cast<uint64_t>(size));
  proto.set_data(values.data_ptr<float>(), values.nbytes());
  return proto;
}

void validate_shapes(const google::protobuf::RepeatedPtrField<v1::Tensor>& tensors,
                     const std::vector<TensorShape>& expected) {
  const auto count = static_cast<size_t>(tensors.size());
  if (count != expected.size()) {
    throw invalid_input(fmt::format("there are {} tensors; there must be {}, {}", count,
                                    expected.size(),
                                    expected.empty() ? "none" : expected.front().name + " ..."));
  }
  for (size_t i = 0; i < count; ++i) require_shape(tensors[static_cast<int>(i)], expected[i]);
}

void validate(const google::protobuf::RepeatedPtrField<v1::Tensor>& tensors,
              const std::vector<TensorShape>& expected) {
  validate_shapes(tensors, expected);
  for (const v1::Tensor& tensor : tensors) require_finite(tensor);
}

void copy_values(const v1::Tensor& tensor, torch::Tensor& destination) {
  std::memcpy(destination.data_ptr<float>(), tensor.data().data(), destination.nbytes());
}

}  // namespace itn
