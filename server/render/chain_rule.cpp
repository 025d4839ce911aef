#include "server/render/chain_rule.h"

#include <fmt/format.h>

#include "common/error.h"

namespace itn {

std::array<double, 3> chain_rule(v1::Parameter parameter, const Material& material) {
  const double albedo_by_sigma_a = -material.albedo / material.sigma_t;
  const double albedo_by_sigma_s = (1 - material.albedo) / material.sigma_t;
  const double sigma_s_by_reduced = 1 / (1 - material.g);
  switch (parameter) {
    case v1::SIGMA_T: return {1, 0, 0};
    case v1::ALBEDO: return {0, 1, 0};
    case v1::G: return {0, 0, 1};
    case v1::SIGMA_A: return {1, albedo_by_sigma_a, 0};
    case v1::SIGMA_S: return {1, albedo_by_sigma_s, 0};
    case v1::SIGMA_S_REDUCED:
      return {sigma_s_by_reduced, albedo_by_sigma_s * sigma_s_by_reduced, 0};
    default: break;
  }
  throw invalid_input(
      fmt::format("{} is not a parameter that has a derivative", static_cast<int>(parameter)));
}

}  // namespace itn
