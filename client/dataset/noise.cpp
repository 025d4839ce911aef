#include "client/dataset/noise.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace itn {

double relative_noise(std::span<const float> radiance, std::span<const float> standard_error,
                      std::span<const float> mask) {
  double noise = 0, energy = 0;  // squared, summed
  for (size_t p = 0; p < mask.size(); ++p) {
    if (!(mask[p] > 0)) continue;
    noise += static_cast<double>(standard_error[p]) * standard_error[p];
    energy += static_cast<double>(radiance[p]) * radiance[p];
  }
  if (noise == 0) return 0;
  // The noise is part of the energy that is measured.
  return energy > noise ? std::sqrt(noise / (energy - noise))
                        : std::numeric_limits<double>::infinity();
}

uint32_t spp_for(const v1::NoiseTarget& target, double pilot_noise) {
  const double spp = target.pilot_spp() * std::pow(pilot_noise / target.target(), 2);
  return static_cast<uint32_t>(std::clamp(std::ceil(spp), static_cast<double>(target.min_spp()),
                                          static_cast<double>(target.max_spp())));
}

}  // namespace itn
