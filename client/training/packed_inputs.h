// What a network takes of every image of a split.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <stop_token>

#include "client/training/packed_derivatives.h"
#include "client/training/packed_images.h"
#include "client/training/training_set.h"
#include "common/learning/network_input.h"

namespace itn {

// Reads, decodes, resamples and packs each image once. A batch is read from there.
class PackedInputs {
 public:
  // `folder`: where the files are. `derivatives`: of the dataset, are packed, too. Throws Error:
  // kInvalidInput (the images are smaller than the format; there are no derivatives), kIo (no room
  // there), kCancelled, and as LabelledImages::read.
  PackedInputs(const LabelledImages& images, const PackedFormat& format,
               const std::filesystem::path& folder, std::stop_token stop = {},
               bool derivatives = false);

  ImageBatch batch(std::span<const uint32_t> items) const { return packed_.batch(items); }

  // Null unless they were packed.
  const PackedDerivatives* derivatives() const { return derivatives_ ? &*derivatives_ : nullptr; }

  size_t size() const { return packed_.size(); }

  const PackedFormat& format() const { return packed_.format(); }

  // Over the objects of all images, weighted by the masks.
  double mean_radiance() const { return mean_radiance_; }

 private:
  void pack(const LabelledImages& images, const std::stop_token& stop);

  PackedImages packed_;
  std::optional<PackedDerivatives> derivatives_;
  double mean_radiance_ = 0;
};

}  // namespace itn
