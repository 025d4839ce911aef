#include "client/training/packed_inputs.h"

#include <vector>

#include "client/training/in_parallel.h"

namespace itn {

PackedInputs::PackedInputs(const LabelledImages& images, const PackedFormat& format,
                           const std::filesystem::path& folder, std::stop_token stop,
                           bool derivatives)
    : packed_(format, images.items.size(), folder) {
  pack(images, stop);
  if (derivatives) derivatives_.emplace(images, format.resolution, folder, stop);
}

void PackedInputs::pack(const LabelledImages& images, const std::stop_token& stop) {
  std::vector<ObjectSums> sums(images.items.size());
  in_parallel(sums.size(), stop, [&](size_t i) {
    const DatasetImage image = images.read(i);
    sums[i] = object_sums(image);
    packed_.put(i, images.resolution, image);
  });
  // In the order of the images, so that the last bits are always the same.
  mean_radiance_ = itn::mean_radiance(sums);
}

}  // namespace itn
