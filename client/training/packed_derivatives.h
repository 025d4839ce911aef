// Derivative images at hand without being in memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <stop_token>

#include <torch/types.h>

#include "client/training/scratch_records.h"
#include "client/training/training_set.h"

namespace itn {

// Derivatives of every image of a split: d luminance / d (sigma_t, albedo, g), the mean of its
// estimates; 12 bytes for each pixel.
class PackedDerivatives {
 public:
  // `resolution`: a side; the images' own, or less. `folder`: where the file is. Throws Error: kIo
  // (no room there), kCancelled, and as LabelledImages::read and ::derivatives.
  PackedDerivatives(const LabelledImages& images, int resolution,
                    const std::filesystem::path& folder, std::stop_token stop = {});

  // items x 3 x resolution x resolution, float. Throws Error (kIo).
  torch::Tensor batch(std::span<const uint32_t> items) const;

 private:
  int resolution_;
  ScratchRecords records_;
};

}  // namespace itn
