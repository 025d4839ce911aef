// SunDisc for many directions at a time.
#if defined(ITN_TRACER_LIGHTS_SUN_DISC_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_SUN_DISC_INL_H_
#undef ITN_TRACER_LIGHTS_SUN_DISC_INL_H_
#else
#define ITN_TRACER_LIGHTS_SUN_DISC_INL_H_
#endif

#include "server/tracer/lights/light-inl.h"
#include "server/tracer/lights/sun_disc.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Emission emission(const SunDisc& sun, Vectors d) {
  const Vectors off = d - set(sun.basis().n);
  const Mask inside =
      hn::Le(hn::Mul(set(0.5F), dot(off, off)), set(static_cast<float>(sun.one_minus_cos())));
  return {hn::IfThenElseZero(inside, set(static_cast<float>(sun.disc_radiance()))),
          hn::IfThenElseZero(inside, set(static_cast<float>(sun.disc_pdf())))};
}

HWY_INLINE Vectors sample(const SunDisc& sun, const LightUniforms& u) {
  const Floats z = hn::Mul(u.u0, set(static_cast<float>(sun.one_minus_cos())));
  const Floats sin_theta = hn::Sqrt(hn::Mul(z, hn::Sub(set(2.0F), z)));
  const SinCos phi = sin_cos_2pi(u.u1);
  const Floats x = hn::Mul(sin_theta, phi.cos), y = hn::Mul(sin_theta, phi.sin);
  return renormalize(set(sun.basis().s) * x + set(sun.basis().t) * y +
                     set(sun.basis().n) * hn::Sub(set(1.0F), z));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
