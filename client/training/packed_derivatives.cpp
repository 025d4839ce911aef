#include "client/training/packed_derivatives.h"

#include <vector>

#include "client/in_parallel.h"
#include "client/render/render_query.h"
#include "common/learning/network_input.h"

namespace itn {
namespace {

size_t derivative_bytes(int resolution) {
  return kMaterialParameters.size() * static_cast<size_t>(resolution) *
         static_cast<size_t>(resolution) * sizeof(float);
}

}  // namespace

PackedDerivatives::PackedDerivatives(const LabelledImages& images, int resolution,
                                     const std::filesystem::path& folder, std::stop_token stop)
    : resolution_(resolution), records_(images.items.size(), derivative_bytes(resolution), folder) {
  in_parallel(records_.size(), stop, [&](size_t i) {
    const std::vector<float> mask = images.read(i).mask;
    const DerivativeImages estimates = images.derivatives(i);
    std::vector<torch::Tensor> planes;
    for (size_t k = 0; k < kMaterialParameters.size(); ++k) {
      std::vector<float> mean(mask.size());
      for (const auto& estimate : estimates) {
        for (size_t p = 0; p < mean.size(); ++p) mean[p] += estimate[k][p] / kDerivativeEstimates;
      }
      planes.push_back(resampled(images.resolution, mean, mask, resolution, v1::RATIOS).luminance);
    }
    records_.put(i, torch::cat(planes).data_ptr());
  });
}

torch::Tensor PackedDerivatives::batch(std::span<const uint32_t> items) const {
  const torch::Tensor planes =
      torch::empty({static_cast<int64_t>(items.size()),
                    static_cast<int64_t>(kMaterialParameters.size()), resolution_, resolution_});
  for (size_t i = 0; i < items.size(); ++i) {
    records_.get(items[i], planes[static_cast<int64_t>(i)].data_ptr());
  }
  return planes;
}

}  // namespace itn
