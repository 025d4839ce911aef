// A disc of constant radiance: the cone of directions within an angle of its axis.
#ifndef ITN_TRACER_LIGHTS_SUN_DISC_H_
#define ITN_TRACER_LIGHTS_SUN_DISC_H_

#include <cmath>
#include <numbers>

#include "common/vec.h"
#include "server/tracer/colour/channel.h"

namespace itn::tracer {

class SunDisc {
 public:
  static constexpr bool kDelta = false, kDistant = true;

  // `irradiance`: on a surface that faces it, as if all of it came from the axis. `colour`: of the
  // disc, on any scale.
  SunDisc(Vec3d axis, double half_angle, double irradiance, const Rgb& colour = {1, 1, 1})
      : basis_(static_cast<Vec3f>(axis)),
        one_minus_cos_(2 * std::pow(std::sin(half_angle / 2), 2)),
        solid_angle_(2 * std::numbers::pi * one_minus_cos_),
        radiance_(irradiance / solid_angle_),
        colours_(radiance_of(colour)) {}

  double power() const { return radiance_ * solid_angle_; }

  const Basis<float>& basis() const { return basis_; }
  double one_minus_cos() const { return one_minus_cos_; }
  double radiance() const { return radiance_; }
  const Rgb& colours() const { return colours_; }
  double pdf() const { return 1 / solid_angle_; }

 private:
  Rgb radiance_of(const Rgb& colour) const {
    const double by = luminance(colour) > 0 ? radiance_ / luminance(colour) : 0;
    return {colour[0] * by, colour[1] * by, colour[2] * by};
  }

  Basis<float> basis_;
  double one_minus_cos_, solid_angle_, radiance_;
  Rgb colours_;
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_SUN_DISC_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_SUN_DISC_MATHS_
#undef ITN_TRACER_LIGHTS_SUN_DISC_MATHS_
#else
#define ITN_TRACER_LIGHTS_SUN_DISC_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Emission emission(const SunDisc& sun, Vectors d) {
  const Vectors off = d - set(sun.basis().n);
  // |d - axis|^2 = 2 (1 - cos_theta): no cancellation for a narrow sun.
  const Mask inside = 0.5F * dot(off, off) <= static_cast<float>(sun.one_minus_cos());
  return {hn::IfThenElseZero(inside, set(static_cast<float>(sun.radiance()))),
          hn::IfThenElseZero(inside, set(static_cast<float>(sun.pdf())))};
}

HWY_INLINE InColours colours(const SunDisc& sun, Vectors /*d*/) {
  InColours result;
  for (size_t c = 0; c < kColours.size(); ++c) {
    result.radiance[c] = set(static_cast<float>(sun.colours()[c]));
  }
  return result;
}

// With z = 1 - cos_theta uniform in [0, 1 - cos(half_angle)]; sin_theta = sqrt(z (2 - z)) holds for
// a narrow sun too, where 1 - cos_theta^2 would cancel.
HWY_INLINE Vectors sample(const SunDisc& sun, const LightUniforms& u) {
  const Floats z = u.u0 * static_cast<float>(sun.one_minus_cos());
  const Floats sin_theta = hn::Sqrt(z * (2 - z));
  const SinCos phi = sin_cos_2pi(u.u1);
  const Floats x = sin_theta * phi.cos, y = sin_theta * phi.sin;
  return renormalize(set(sun.basis().s) * x + set(sun.basis().t) * y +
                     set(sun.basis().n) * (1 - z));
}

HWY_INLINE Outline outline(const SunDisc& sun, Vectors /*from*/, Floats u, bool opposite) {
  const double z = sun.one_minus_cos(), sine = std::sqrt(z * (2 - z));
  const SinCos phi = sin_cos_2pi(u);
  const float side = opposite ? -1.0F : 1.0F;
  const Vectors outwards =
      (set(sun.basis().s) * phi.cos + set(sun.basis().t) * phi.sin) * set(side);
  const Vectors direction = outwards * set(static_cast<float>(sine)) +
                            set(sun.basis().n) * set(static_cast<float>(1 - z));
  return {renormalize(direction), set(kInfinity),
          outwards * set(static_cast<float>(std::numbers::pi * sine)),
          set(static_cast<float>(sun.radiance()))};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
