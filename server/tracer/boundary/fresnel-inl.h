// Reflection and refraction at a plane (Fresnel's and Snell's laws) of light without polarisation.
#if defined(ITN_TRACER_BOUNDARY_FRESNEL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_BOUNDARY_FRESNEL_INL_H_
#undef ITN_TRACER_BOUNDARY_FRESNEL_INL_H_
#else
#define ITN_TRACER_BOUNDARY_FRESNEL_INL_H_
#endif

#include "server/tracer/boundary/crossing-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Vectors mirrored(Vectors d, Vectors normal) {
  return renormalize(d - normal * hn::Mul(set(2.0F), dot(d, normal)));
}

// Of two indices of refraction, that beyond the boundary over that before it.
HWY_INLINE Floats index_ahead(float relative_index, Mask leaving) {
  return hn::IfThenElse(leaving, set(1 / relative_index), set(relative_index));
}

// What light does that arrives under an angle to the normal.
struct Fresnel {
  Floats reflected;         // the part of its power; 1 where reflection is total
  Floats refracted_cosine;  // of the angle on the other side; 0 where reflection is total
};

// `cosine`: in [0, 1], of the angle before the boundary; `index`: see index_ahead. With r_s and r_p
// the amplitudes of the two polarisations.
HWY_INLINE Fresnel fresnel(Floats cosine, Floats index) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  const Floats c = hn::Max(cosine, set(1e-7F));  // along the boundary both quotients would be 0 / 0
  const Floats sine2 = hn::Max(zero, hn::Sub(one, hn::Mul(c, c)));
  const Floats refracted =
      hn::Sqrt(hn::Max(zero, hn::Sub(one, hn::Div(sine2, hn::Mul(index, index)))));
  const auto amplitude = [](Floats a, Floats b) { return hn::Div(hn::Sub(a, b), hn::Add(a, b)); };
  const Floats r_s = amplitude(c, hn::Mul(index, refracted));
  const Floats r_p = amplitude(hn::Mul(index, c), refracted);
  return {hn::Mul(set(0.5F), mul_add(r_s, r_s, hn::Mul(r_p, r_p))), refracted};
}

// The direction behind the boundary of light in direction d, which arrives at the side of `normal`.
HWY_INLINE Vectors refracted(Vectors d, Vectors normal, Floats cosine, Floats refracted_cosine,
                             Floats index) {
  const Floats per_index = hn::Div(set(1.0F), index);
  return renormalize(d * per_index +
                     normal * hn::Sub(hn::Mul(cosine, per_index), refracted_cosine));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
