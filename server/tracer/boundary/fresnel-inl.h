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
  return renormalize(d - normal * (2 * dot(d, normal)));
}

// The index of refraction beyond the boundary over that before it.
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
  const Floats zero = hn::Zero(FloatTag());
  const Floats c = hn::Max(cosine, set(1e-7F));  // along the boundary both quotients would be 0 / 0
  const Floats sine2 = hn::Max(zero, 1 - c * c);
  const Floats refracted = hn::Sqrt(hn::Max(zero, 1 - sine2 / (index * index)));
  const auto amplitude = [](Floats a, Floats b) { return (a - b) / (a + b); };
  const Floats r_s = amplitude(c, index * refracted);
  const Floats r_p = amplitude(index * c, refracted);
  return {0.5F * mul_add(r_s, r_s, r_p * r_p), refracted};
}

// The derivative of `reflected` where the cosine and the index have these. With q the index times
// the refracted cosine, r_s = (c - q) / (c + q) and r_p = (index^2 c - q) / (index^2 c + q).
HWY_INLINE Floats reflected_slope(Floats cosine, Floats index, Floats d_cosine, Floats d_index) {
  const Floats index2 = index * index;
  const Floats c = hn::Max(cosine, set(1e-7F));
  const Floats q2 = index2 - 1 + c * c;
  const Floats q = hn::Sqrt(hn::Max(q2, set(1e-6F)));  // what rounding leaves of it
  const Floats d_q = mul_add(index, d_index, c * d_cosine) / q;
  // The derivative of the square of (a - q) / (a + q).
  const auto d_square = [&](Floats a, Floats d_a) {
    const Floats sum = a + q;
    const Floats turn = q * d_a - a * d_q;
    const Floats by = (a - q) * turn / (sum * (sum * sum));
    return 4 * by;
  };
  const Floats d_p = mul_add(index2, d_cosine, 2 * index * (c * d_index));
  const Floats slope = d_square(c, d_cosine) + d_square(index2 * c, d_p);
  return hn::IfThenElseZero(q2 > 0, 0.5F * slope);
}

// The direction behind the boundary of light in direction d, which arrives at the side of `normal`.
HWY_INLINE Vectors refracted(Vectors d, Vectors normal, Floats cosine, Floats refracted_cosine,
                             Floats index) {
  const Floats per_index = 1 / index;
  return renormalize(d * per_index + normal * (cosine * per_index - refracted_cosine));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
