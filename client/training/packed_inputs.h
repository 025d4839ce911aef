// What a network takes of every image of a split, at hand without being in memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <stop_token>

#include <torch/torch.h>

#include "client/training/training_set.h"

namespace itn {

// Reads, decodes and weighs each image once and packs the result into a file without a name, which
// goes when this does, however the process ends. A batch is read from there: the memory that it
// takes does not depend on how many images there are, and the operating system keeps what it has
// room for. The file has 8 bytes for each pixel of each image.
class PackedInputs {
 public:
  // `folder`: where the file is. Throws Error: kIo (no room there), kCancelled, and as
  // LabelledImages::read.
  PackedInputs(const LabelledImages& images, const std::filesystem::path& folder,
               std::stop_token stop = {});
  ~PackedInputs();
  PackedInputs(const PackedInputs&) = delete;
  PackedInputs& operator=(const PackedInputs&) = delete;

  // items x 2 x resolution x resolution, as encoder_input().
  torch::Tensor batch(std::span<const uint32_t> items, double image_scale) const;

  // Over the objects of all images, weighted by the masks.
  double mean_radiance() const { return mean_radiance_; }

 private:
  void pack(const LabelledImages& images, std::stop_token stop);

  int resolution_;
  int descriptor_ = -1;
  double mean_radiance_ = 0;
};

}  // namespace itn
