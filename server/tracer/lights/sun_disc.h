// A disc of constant radiance: the cone of directions within an angle of its axis.
#pragma once

#include <cmath>
#include <numbers>

#include "common/vec.h"

namespace itn::tracer {

// See ConstantLight for what its functions mean.
class SunDisc {
 public:
  static constexpr bool kDelta = false;

  // `irradiance`: on a surface that faces it, as if all of it came from the axis.
  SunDisc(Vec3d axis, double half_angle, double irradiance)
      : basis_(static_cast<Vec3f>(axis)),
        one_minus_cos_(2 * std::pow(std::sin(half_angle / 2), 2)),
        solid_angle_(2 * std::numbers::pi * one_minus_cos_),
        radiance_(irradiance / solid_angle_) {}

  double radiance_of(Vec3f d) const { return inside(d) ? radiance_ : 0; }
  double pdf(Vec3f d) const { return inside(d) ? 1 / solid_angle_ : 0; }

  // With z = 1 - cos_theta uniform in [0, 1 - cos(half_angle)]; sin_theta = sqrt(z (2 - z)) holds
  // for a narrow sun too, where 1 - cos_theta^2 would cancel.
  Vec3f sample([[maybe_unused]] double u, float u0, float u1) const {
    const float z = u0 * static_cast<float>(one_minus_cos_);
    const float sin_theta = std::sqrt(z * (2 - z));
    const float phi = 2 * std::numbers::pi_v<float> * u1;
    return itn::normalize(
        basis_.to_world(sin_theta * std::cos(phi), sin_theta * std::sin(phi), 1 - z));
  }
  double power() const { return radiance_ * solid_angle_; }

  const Basis<float>& basis() const { return basis_; }
  double one_minus_cos() const { return one_minus_cos_; }
  double disc_radiance() const { return radiance_; }
  double disc_pdf() const { return 1 / solid_angle_; }

 private:
  // |d - axis|^2 = 2 (1 - cos_theta): no cancellation for a narrow sun.
  bool inside(Vec3f d) const {
    const Vec3f difference = d - basis_.n;
    return 0.5 * static_cast<double>(dot(difference, difference)) <= one_minus_cos_;
  }

  Basis<float> basis_;
  double one_minus_cos_, solid_angle_, radiance_;
};

}  // namespace itn::tracer
