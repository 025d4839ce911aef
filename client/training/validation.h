// How a network does on images of shapes that it does not learn from, while it learns.
#pragma once

#include <cstdint>

#include "client/training/packed_inputs.h"
#include "client/training/training_set.h"
#include "common/learning/predictor.h"
#include "itn/v1/learning.pb.h"

namespace itn {

class Validation {
 public:
  // What is referred to must outlive it. The images are brought up to the relative noise `noise`,
  // as those of training are; always by the same random numbers.
  Validation(const LabelledImages& images, const PackedInputs& inputs, double noise);

  // Errors of the model, which has weights, over those of the constant predictor.
  v1::ValidationMetrics measure(const v1::Model& model) const;

 private:
  const LabelledImages& images_;
  const PackedInputs& inputs_;
  double noise_;
};

// What a run's best checkpoint has least of: the mean of the three errors.
double score(const v1::ValidationMetrics& metrics);

}  // namespace itn
