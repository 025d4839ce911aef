#include "common/material.h"

#include <cmath>

#include "common/fields.h"

namespace itn {

double diffuse_albedo(const Material& material) {
  // (1 - albedo) / (1 - albedo g), which similar materials have in common.
  const double sigma_a = material.sigma_a();
  const double s = std::sqrt(sigma_a / (sigma_a + material.sigma_s_reduced()));
  return (1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s);
}

double diffusion_length(const Material& material) {
  const double sigma_a = material.sigma_a();
  return 1 / std::sqrt(3 * sigma_a * (sigma_a + material.sigma_s_reduced()));
}

void validate(const Material& material, const std::string& what) {
  in_closed(what + ".sigma_t", material.sigma_t, kMinSigmaT, kMaxSigmaT);
  in_closed(what + ".albedo", material.albedo, 0, 1);
  in_closed(what + ".g", material.g, -kMaxAbsG, kMaxAbsG);
}

}  // namespace itn
