// What a network takes of every image of a split, at hand without being in memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <stop_token>
#include <vector>

#include "client/training/training_set.h"
#include "common/learning/network_input.h"

namespace itn {

// What of the images a network will be shown (network_input()).
struct PackedFormat {
  int resolution = 0;  // a side; the images' own, or less: then they are averaged down
  v1::NetworkInput input = v1::LUMINANCE_AND_WEIGHT;
};

// Reads, decodes and resamples each image once and packs the result, luminance and mask and maybe
// the weight map, into a file without a name, which goes when this does, however the process ends.
// A batch is read from there: the memory that it takes does not depend on how many images there
// are, and the operating system keeps what it has room for. The file has 8 or, with the weight map,
// 12 bytes for each pixel of each image.
class PackedInputs {
 public:
  // `folder`: where the file is. Throws Error: kInvalidInput (the images are smaller than the
  // format), kIo (no room there), kCancelled, and as LabelledImages::read.
  PackedInputs(const LabelledImages& images, const PackedFormat& format,
               const std::filesystem::path& folder, std::stop_token stop = {});
  ~PackedInputs();
  PackedInputs(const PackedInputs&) = delete;
  PackedInputs& operator=(const PackedInputs&) = delete;

  ImageBatch batch(std::span<const uint32_t> items) const;

  const PackedFormat& format() const { return format_; }

  // Over the objects of all images, weighted by the masks.
  double mean_radiance() const { return mean_radiance_; }

 private:
  void pack(const LabelledImages& images, std::stop_token stop);

  int planes() const;  // of each image

  PackedFormat format_;
  int descriptor_ = -1;
  std::vector<float> noise_;  // relative, of each image at this resolution
  double mean_radiance_ = 0;
};

}  // namespace itn
