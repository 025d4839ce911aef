// What the estimates of a render are together, and what they are called in files.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "common/render_estimate.h"
#include "common/scene/wire_array.h"
#include "itn/v1/render.pb.h"

namespace itn {

// The mean over all samples, of the means of the estimates. `image_of`: the bytes of the image of
// an estimate.
std::vector<float> mean_of_estimates(const v1::RenderGradReply& reply, uint32_t spp,
                                     const auto& image_of) {
  if (reply.estimates_size() == 1) return from_bytes<float>(image_of(reply.estimates(0)));
  const uint32_t estimates = static_cast<uint32_t>(reply.estimates_size());
  std::vector<double> sum(size_t{reply.width()} * reply.height());
  for (uint32_t k = 0; k < estimates; ++k) {
    const uint32_t samples = samples_of_estimate(spp, k, estimates);
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

// The standard error of that mean by how far the estimates are apart: K estimates come with K - 1
// degrees of freedom. There must be two at least.
std::vector<float> standard_error_of_estimates(const v1::RenderGradReply& reply,
                                               const auto& image_of) {
  const int count = reply.estimates_size();
  std::vector<double> sum(size_t{reply.width()} * reply.height()), squares(sum.size());
  for (const v1::Estimate& estimate : reply.estimates()) {
    const std::vector<float> image = from_bytes<float>(image_of(estimate));
    for (size_t i = 0; i < sum.size(); ++i) {
      sum[i] += image[i];
      squares[i] += static_cast<double>(image[i]) * image[i];
    }
  }
  std::vector<float> result;
  for (size_t i = 0; i < sum.size(); ++i) {
    const double deviations = std::max(0.0, squares[i] - sum[i] * sum[i] / count);
    result.push_back(static_cast<float>(std::sqrt(deviations / (count - 1.0) / count)));
  }
  return result;
}

// The channel of estimate k of a derivative image, e.g. "estimate0.sigma_t.Y".
inline std::string estimate_channel(int k, const std::string& derivative,
                                    const std::string& channel = "Y") {
  return fmt::format("estimate{}.{}.{}", k, derivative, channel);
}

}  // namespace itn
