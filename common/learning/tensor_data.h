// Tensors as plain data. Nothing that is read here is executed, and nothing is allocated before its
// size is known to be the one that the network has.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <google/protobuf/repeated_ptr_field.h>
#include <torch/types.h>

#include "itn/v1/learning.pb.h"

namespace itn {

struct TensorShape {
  std::string name;
  std::vector<int64_t> shape;
};

// Writes a tensor of float32.
v1::Tensor to_proto(const std::string& name, const torch::Tensor& tensor);

// Throws Error (invalid input) that names the first tensor which is missing, too many, or of
// another name, type, shape or size than expected.
void validate_shapes(const google::protobuf::RepeatedPtrField<v1::Tensor>& tensors,
                     const std::vector<TensorShape>& expected);

// The same, and of one that holds a value that is not finite.
void validate(const google::protobuf::RepeatedPtrField<v1::Tensor>& tensors,
              const std::vector<TensorShape>& expected);

// Puts the values in the place of the destination's, which has the same shape. Requires that
// validate() has passed.
void copy_values(const v1::Tensor& tensor, torch::Tensor& destination);

}  // namespace itn
