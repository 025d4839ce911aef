// Light of one radiance from all directions.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/vec.h"

namespace itn::tracer {

// Like every kind of light but DirectionalLight, it answers for unit directions:
//   radiance_of(d)
//   pdf(d)             the density per steradian with which `sample` draws d
//   sample(u, u0, u1)  a direction from uniform numbers in [0, 1): u chooses among cells, of which
//                      there may be millions, u0 and u1 a direction within
//   power()            radiance integrated over all directions
// The same for many directions at a time is in constant-inl.h.
struct ConstantLight {
  double radiance = 1;

  static constexpr bool kDelta = false;
  static constexpr double kPdf = 1 / (4 * std::numbers::pi);

  double radiance_of(Vec3f) const { return radiance; }
  double pdf(Vec3f) const { return kPdf; }
  Vec3f sample([[maybe_unused]] double u, float u0, float u1) const {
    const float y = 1 - 2 * u0;
    const float r = std::sqrt(std::max(0.0F, 1 - y * y));
    const float phi = 2 * std::numbers::pi_v<float> * u1;
    return {r * std::cos(phi), y, r * std::sin(phi)};
  }
  double power() const { return radiance / kPdf; }
};

}  // namespace itn::tracer
