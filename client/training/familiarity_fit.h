// Shows a trained network images of its training and others, so that it will know what it has not
// seen (common/learning/familiarity.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>

#include "client/training/packed_inputs.h"
#include "common/learning/network_input.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// Images at hand, by number, at the resolution of a model.
struct ImageSource {
  size_t count = 0;
  std::function<ImageBatch(std::span<const uint32_t>)> batch;
};

// All of a split, which must outlive it.
ImageSource source_of(const PackedInputs& inputs);

// Of a model with weights, from up to 1024 images of each source, evenly spread. `held_out`: of
// shapes that the model was not trained with; without any, a quarter of the training images take
// their place, which are a little too familiar. Nothing if there are less than 32 training images.
// Deterministic. Throws Error (cancelled) soon after a stop.
std::optional<v1::Familiarity> measure_familiarity(const v1::Model& model,
                                                   const ImageSource& training,
                                                   const ImageSource& held_out,
                                                   const std::stop_token& stop = {});

}  // namespace itn
