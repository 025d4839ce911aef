#include "client/training/packed_inputs.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <vector>

#include "client/in_parallel.h"
#include "client/training/noise_map.h"
#include "common/error.h"

namespace itn {
namespace {

// What there is of a channel of an image.
int plane_count(const PackedFormat& format) {
  return needs_weight_map(format.input) ? 4 : 3;
}

size_t image_bytes(const PackedFormat& format) {
  const auto side = static_cast<size_t>(format.resolution);
  const auto planes = static_cast<size_t>(plane_count(format) * format.channels);
  return planes * side * side * sizeof(float);
}

// Over the object of an image, weighted by the mask.
struct ObjectSums {
  double radiance = 0, area = 0;  // the area in pixels
};

void add(ObjectSums& sums, const DatasetImage& image) {
  for (size_t p = 0; p < image.mask.size(); ++p) {
    sums.radiance += static_cast<double>(image.mask[p]) * image.radiance[p];
    sums.area += image.mask[p];
  }
}

}  // namespace

PackedInputs::PackedInputs(const LabelledImages& images, const PackedFormat& format,
                           const std::filesystem::path& folder, std::stop_token stop,
                           bool derivatives)
    : format_(format), records_(images.items.size(), image_bytes(format), folder) {
  pack(images, stop);
  if (derivatives) derivatives_.emplace(images, format.resolution, folder, stop);
}

void PackedInputs::pack(const LabelledImages& images, const std::stop_token& stop) {
  if (format_.channels != static_cast<int>(images.channels)) {
    throw invalid_input(
        fmt::format("the network is for images with {}; those of the dataset have {}",
                    format_.channels == 1 ? "one channel" : "three channels, in colour",
                    images.channels == 1 ? "one" : "three"));
  }
  if (format_.resolution > images.resolution) {
    throw invalid_input(fmt::format(
        "the network is for {0} x {0} pixels; the images have {1} x {1}, which are fewer",
        format_.resolution, images.resolution));
  }
  std::vector<ObjectSums> sums(size());
  in_parallel(sums.size(), stop, [&](size_t i) {
    std::vector<torch::Tensor> planes;
    for (const DatasetImage& channel : read_channels(images, i)) {
      add(sums[i], channel);
      ImageBatch packed = resampled(images.resolution, channel.radiance, channel.mask,
                                    format_.resolution, format_.input);
      packed.noise = noise_map(channel, images.resolution, format_.resolution);
      std::ranges::copy(planes_of(packed), std::back_inserter(planes));
    }
    records_.put(i, torch::cat(planes).data_ptr());
  });
  // In the order of the images, so that the last bits are always the same.
  ObjectSums all;
  for (const ObjectSums& image : sums) {
    all.radiance += image.radiance;
    all.area += image.area;
  }
  if (all.area > 0) mean_radiance_ = all.radiance / all.area;
}

ImageBatch PackedInputs::batch(std::span<const uint32_t> items) const {
  const auto images = static_cast<int64_t>(items.size());
  const torch::Tensor planes = torch::empty(
      {images * format_.channels, plane_count(format_), format_.resolution, format_.resolution});
  for (int64_t i = 0; i < images; ++i) {
    records_.get(items[static_cast<size_t>(i)], planes[i * format_.channels].data_ptr());
  }
  const bool weight = needs_weight_map(format_.input);
  return {.luminance = planes.select(1, 0),
          .mask = planes.select(1, 1),
          .weight = weight ? planes.select(1, 2) : torch::Tensor(),
          .noise = planes.select(1, weight ? 3 : 2),
          .channels = format_.channels};
}

}  // namespace itn
