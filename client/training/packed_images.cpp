#include "client/training/packed_images.h"

#include <fmt/format.h>

#include "client/training/noise_map.h"
#include "common/error.h"

namespace itn {
namespace {

// Of each image.
int planes(const PackedFormat& format) {
  return needs_weight_map(format.input) ? 4 : 3;
}

size_t image_bytes(const PackedFormat& format) {
  const auto side = static_cast<size_t>(format.resolution);
  return static_cast<size_t>(planes(format)) * side * side * sizeof(float);
}

}  // namespace

PackedImages::PackedImages(const PackedFormat& format, size_t count,
                           const std::filesystem::path& folder)
    : format_(format), records_(count, image_bytes(format), folder) {}

void PackedImages::put(size_t place, int resolution, const DatasetImage& image) {
  if (format_.resolution > resolution) {
    throw invalid_input(fmt::format(
        "the network is for {0} x {0} pixels; the images have {1} x {1}, which are fewer",
        format_.resolution, resolution));
  }
  ImageBatch packed =
      resampled(resolution, image.radiance, image.mask, format_.resolution, format_.input);
  packed.noise = noise_map(image, resolution, format_.resolution);
  records_.put(place, torch::cat(planes_of(packed)).data_ptr());
}

ImageBatch PackedImages::batch(std::span<const uint32_t> places) const {
  const torch::Tensor planes =
      torch::empty({static_cast<int64_t>(places.size()), itn::planes(format_), format_.resolution,
                    format_.resolution});
  for (size_t i = 0; i < places.size(); ++i) {
    records_.get(places[i], planes[static_cast<int64_t>(i)].data_ptr());
  }
  const bool weight = needs_weight_map(format_.input);
  return {.luminance = planes.select(1, 0),
          .mask = planes.select(1, 1),
          .weight = weight ? planes.select(1, 2) : torch::Tensor(),
          .noise = planes.select(1, weight ? 3 : 2)};
}

ObjectSums object_sums(const DatasetImage& image) {
  ObjectSums sums;
  for (size_t p = 0; p < image.mask.size(); ++p) {
    sums.radiance += static_cast<double>(image.mask[p]) * image.radiance[p];
    sums.area += image.mask[p];
  }
  return sums;
}

double mean_radiance(std::span<const ObjectSums> images) {
  ObjectSums all;
  for (const ObjectSums& image : images) {
    all.radiance += image.radiance;
    all.area += image.area;
  }
  return all.area > 0 ? all.radiance / all.area : 0;
}

}  // namespace itn
