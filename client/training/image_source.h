// Images at hand for whoever measures a trained network: of a dataset's split.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "client/training/packed_inputs.h"
#include "common/learning/network_input.h"
#include "common/material.h"

namespace itn {

// That go through a network together when it is measured.
inline constexpr size_t kImagesAtATime = 32;

// By number, at the resolution of a model.
struct ImageSource {
  size_t count = 0;
  std::function<ImageBatch(std::span<const uint32_t>)> batch;
};

// Images of shapes that a model was not trained with, and the truth of each of their channels.
struct HeldOutImages {
  ImageSource images;
  std::span<const Material> truth;
};

// All of a split, which must outlive it.
inline ImageSource source_of(const PackedInputs& inputs) {
  return {.count = inputs.size(),
          .batch = [&inputs](std::span<const uint32_t> items) { return inputs.batch(items); }};
}

}  // namespace itn
