#include "common/material.h"

#include <fmt/format.h>

#include "common/error.h"

namespace itn {

void validate(const Material& material, const std::string& what) {
  const auto check = [&](const char* name, double value, double low, double high) {
    // Negated so that NaN fails too.
    if (!(value >= low && value <= high)) {
      throw invalid_input(
          fmt::format("{}.{} is {}; it must be in [{}, {}]", what, name, value, low, high));
    }
  };
  check("sigma_t", material.sigma_t, kMinSigmaT, kMaxSigmaT);
  check("albedo", material.albedo, 0, 1);
  check("g", material.g, -kMaxAbsG, kMaxAbsG);
}

}  // namespace itn
