// What the estimates of a render are together, and what they are called in files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "common/rpc/wire_array.h"
#include "itn/v1/render.pb.h"

namespace itn {

// The mean over all samples, of the means of the estimates: estimate k has the samples
// k, k + K, k + 2 K, ... below spp. `image_of`: the bytes of the image of an estimate.
std::vector<float> mean_of_estimates(const v1::RenderGradReply& reply, uint32_t spp,
                                     const auto& image_of) {
  if (reply.estimates_size() == 1) return from_bytes<float>(image_of(reply.estimates(0)));
  const uint32_t estimates = static_cast<uint32_t>(reply.estimates_size());
  std::vector<double> sum(size_t{reply.width()} * reply.height());
  for (uint32_t k = 0; k < estimates; ++k) {
    const uint32_t samples = (spp - k + estimates - 1) / estimates;
    const std::vector<float> image =
        from_bytes<float>(image_of(reply.estimates(static_cast<int>(k))));
    for (size_t i = 0; i < sum.size(); ++i) sum[i] += static_cast<double>(samples) / spp * image[i];
  }
  return {sum.begin(), sum.end()};
}

inline std::vector<float> mean_radiance(const v1::RenderGradReply& reply, uint32_t spp) {
  return mean_of_estimates(
      reply, spp, [](const v1::Estimate& e) -> const std::string& { return e.radiance(); });
}

// The channel of estimate k of a derivative image, e.g. "estimate0.sigma_t.Y".
inline std::string estimate_channel(int k, const std::string& derivative) {
  return fmt::format("estimate{}.{}.Y", k, derivative);
}

}  // namespace itn
