// What a network takes of every image of a split, at hand without being in memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <stop_token>

#include "client/training/packed_derivatives.h"
#include "client/training/scratch_records.h"
#include "client/training/training_set.h"
#include "common/learning/network_input.h"

namespace itn {

// What of the images a network will be shown (network_input()).
struct PackedFormat {
  int resolution = 0;  // a side; the images' own, or less: then they are averaged down
  v1::NetworkInput input = v1::LUMINANCE_AND_WEIGHT;
  int channels = 1;  // of the images
};

// Reads, decodes, resamples and packs each image once: of each channel luminance, mask, maybe the
// weight map, and noise, 12 or 16 bytes for each pixel. A batch is read from there.
class PackedInputs {
 public:
  // `folder`: where the files are. `derivatives`: of the dataset, are packed, too. Throws Error:
  // kInvalidInput (the images are smaller than the format, or
  // have other channels; there are no derivatives), kIo (no room
  // there), kCancelled, and as LabelledImages::read.
  PackedInputs(const LabelledImages& images, const PackedFormat& format,
               const std::filesystem::path& folder, std::stop_token stop = {},
               bool derivatives = false);

  // Throws Error (kIo).
  ImageBatch batch(std::span<const uint32_t> items) const;

  // Null unless they were packed.
  const PackedDerivatives* derivatives() const { return derivatives_ ? &*derivatives_ : nullptr; }

  size_t size() const { return records_.size(); }

  const PackedFormat& format() const { return format_; }

  // Over the objects of all images, weighted by the masks; 0 if there are none.
  double mean_radiance() const { return mean_radiance_; }

 private:
  void pack(const LabelledImages& images, const std::stop_token& stop);

  PackedFormat format_;
  ScratchRecords records_;
  std::optional<PackedDerivatives> derivatives_;
  double mean_radiance_ = 0;
};

}  // namespace itn
