// Images at hand without being in memory, as a network will be shown them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/training/scratch_records.h"
#include "common/learning/network_input.h"

namespace itn {

// What of the images a network will be shown (network_input()).
struct PackedFormat {
  int resolution = 0;  // a side; the images' own, or less: then they are averaged down
  v1::NetworkInput input = v1::LUMINANCE_AND_WEIGHT;
};

// So many places for images (ScratchRecords): luminance, mask, maybe the weight map, and noise, 12
// or 16 bytes for each pixel.
class PackedImages {
 public:
  // Throws as ScratchRecords does.
  PackedImages(const PackedFormat& format, size_t count, const std::filesystem::path& folder);

  // Puts an image of `resolution` pixels a side, which is not below the format's, into a place.
  // Several threads may do so at a time, each in a place of its own. Throws Error: kInvalidInput
  // (the image is smaller than the format), kIo.
  void put(size_t place, int resolution, const DatasetImage& image);

  // Of places into which something was put. Throws Error (kIo).
  ImageBatch batch(std::span<const uint32_t> places) const;

  const PackedFormat& format() const { return format_; }
  size_t size() const { return records_.size(); }

 private:
  PackedFormat format_;
  ScratchRecords records_;
};

// Sum of the radiance over the object of an image, and the object's area in pixels; weighted by the
// mask.
struct ObjectSums {
  double radiance = 0, area = 0;
};
ObjectSums object_sums(const DatasetImage& image);

// Over the objects of all these images; 0 if there are none. Summed in their order.
double mean_radiance(std::span<const ObjectSums> images);

}  // namespace itn
