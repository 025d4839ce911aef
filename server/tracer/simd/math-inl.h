// Elementary functions for many numbers at a time. Of additions, multiplications, divisions, square
// roots and fused multiply-adds, each rounded once and fused where it says so, so that every
// instruction set computes the same bits; libraries fuse where the processor can. Errors are
// relative, against the exact result.
#if defined(ITN_TRACER_SIMD_MATH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SIMD_MATH_INL_H_
#undef ITN_TRACER_SIMD_MATH_INL_H_
#else
#define ITN_TRACER_SIMD_MATH_INL_H_
#endif

#include <hwy/highway.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "server/tracer/simd/columns.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using FloatTag = hn::CappedTag<float, kMaxLanes>;
using IntTag = hn::RebindToSigned<FloatTag>;
using UintTag = hn::RebindToUnsigned<FloatTag>;
using Floats = hn::Vec<FloatTag>;
using Ints = hn::Vec<IntTag>;
using Uints = hn::Vec<UintTag>;
using Mask = hn::Mask<FloatTag>;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

HWY_INLINE size_t lanes() {
  return hn::Lanes(FloatTag());
}

HWY_INLINE Floats set(float v) {
  return hn::Set(FloatTag(), v);
}
HWY_INLINE Uints set(uint32_t v) {
  return hn::Set(UintTag(), v);
}

// Formulas are infix. Highway's vectors have operators; here a number beside a vector stands for a
// vector of it, and masks are sets.
HWY_INLINE Floats operator-(Floats v) {
  return hn::Neg(v);
}
HWY_INLINE Floats operator+(Floats a, float b) {
  return a + set(b);
}
HWY_INLINE Floats operator+(float a, Floats b) {
  return set(a) + b;
}
HWY_INLINE Floats operator-(Floats a, float b) {
  return a - set(b);
}
HWY_INLINE Floats operator-(float a, Floats b) {
  return set(a) - b;
}
HWY_INLINE Floats operator*(Floats a, float b) {
  return a * set(b);
}
HWY_INLINE Floats operator*(float a, Floats b) {
  return set(a) * b;
}
HWY_INLINE Floats operator/(Floats a, float b) {
  return a / set(b);
}
HWY_INLINE Floats operator/(float a, Floats b) {
  return set(a) / b;
}
HWY_INLINE Mask operator<(Floats a, float b) {
  return a < set(b);
}
HWY_INLINE Mask operator>(Floats a, float b) {
  return a > set(b);
}
HWY_INLINE Mask operator<=(Floats a, float b) {
  return a <= set(b);
}
HWY_INLINE Mask operator>=(Floats a, float b) {
  return a >= set(b);
}
HWY_INLINE Mask operator&(Mask a, Mask b) {
  return hn::And(a, b);
}
HWY_INLINE Mask& operator&=(Mask& a, Mask b) {
  return a = a & b;
}
HWY_INLINE Mask operator|(Mask a, Mask b) {
  return hn::Or(a, b);
}
HWY_INLINE Mask& operator|=(Mask& a, Mask b) {
  return a = a | b;
}
HWY_INLINE Mask operator^(Mask a, Mask b) {
  return hn::Xor(a, b);
}
HWY_INLINE Mask operator!(Mask a) {
  return hn::Not(a);
}

// a b + c, rounded once.
HWY_INLINE Floats mul_add(Floats a, Floats b, Floats c) {
#if HWY_NATIVE_FMA
  return hn::MulAdd(a, b, c);
#else
  static_assert(HWY_TARGET == HWY_SCALAR);
  return set(std::fma(hn::GetLane(a), hn::GetLane(b), hn::GetLane(c)));
#endif
}

// ln x for positive normal x, to 2e-7 of the result or of 1e-7 near x = 1. With x = m 2^e, m in
// [sqrt 1/2, sqrt 2), and s = (m - 1) / (m + 1): ln m = 2 artanh s = 2 s (1 + s^2/3 + s^4/5 + ...),
// |s| < 0.172, so five terms leave 2e-9.
HWY_INLINE Floats log(Floats x) {
  const IntTag di;
  const FloatTag d;
  constexpr int32_t kSqrtHalf = 0x3F3504F3, kMantissa = 0x007FFFFF;
  const Ints bits = hn::BitCast(di, x) - hn::Set(di, kSqrtHalf);
  const Floats exponent = hn::ConvertTo(d, hn::ShiftRight<23>(bits));
  const Floats m = hn::BitCast(d, (bits & hn::Set(di, kMantissa)) + hn::Set(di, kSqrtHalf));
  const Floats one = set(1.0F);
  const Floats s = (m - 1) / (m + 1);
  const Floats s2 = s * s;
  Floats series = mul_add(s2, set(1.0F / 9), set(1.0F / 7));
  series = mul_add(s2, series, set(1.0F / 5));
  series = mul_add(s2, series, set(1.0F / 3));
  series = mul_add(s2, series, one);
  // ln 2 in two parts, of which the first has few digits, so that its product is exact.
  constexpr float kLn2High = 0.693359375F, kLn2Low = -2.12194440e-4F;
  const Floats low = mul_add(s + s, series, exponent * kLn2Low);
  return mul_add(exponent, set(kLn2High), low);
}

// exp x to 2e-7, for x in [-87, 88]; below, exp(-87). With x = k ln 2 + r, |r| <= ln 2 / 2: eight
// terms of the series in r leave 5e-9.
HWY_INLINE Floats exp(Floats x) {
  const IntTag di;
  const FloatTag d;
  x = hn::Max(x, set(-87.0F));
  const Floats k = hn::Round(x * std::numbers::log2e_v<float>);
  Floats r = x - k * 0.693359375F;
  r -= k * (-2.12194440e-4F);
  Floats series = mul_add(r, set(1.0F / 5040), set(1.0F / 720));
  series = mul_add(r, series, set(1.0F / 120));
  series = mul_add(r, series, set(1.0F / 24));
  series = mul_add(r, series, set(1.0F / 6));
  series = mul_add(r, series, set(0.5F));
  series = mul_add(r, series, set(1.0F));
  series = mul_add(r, series, set(1.0F));
  const Ints scale = hn::ShiftLeft<23>(hn::ConvertTo(di, k) + hn::Set(di, 127));
  return series * hn::BitCast(d, scale);
}

struct SinCos {
  Floats sin, cos;
};

// sin and cos of 2 pi u for u in [0, 1], to 1e-7 absolute. The turn is cut into quarters around
// multiples of pi/2; what is left, |r| <= pi/4, goes into the two series.
HWY_INLINE SinCos sin_cos_2pi(Floats u) {
  const IntTag di;
  const FloatTag d;
  const Floats quarter = hn::Round(u * 4);
  const Floats r = (u * 4 - quarter) * (std::numbers::pi_v<float> / 2);
  const Floats r2 = r * r;
  Floats sine = mul_add(r2, set(1.0F / 362880), set(-1.0F / 5040));
  sine = mul_add(r2, sine, set(1.0F / 120));
  sine = mul_add(r2, sine, set(-1.0F / 6));
  sine = r * mul_add(r2, sine, set(1.0F));
  Floats cosine = mul_add(r2, set(1.0F / 40320), set(-1.0F / 720));
  cosine = mul_add(r2, cosine, set(1.0F / 24));
  cosine = mul_add(r2, cosine, set(-0.5F));
  cosine = mul_add(r2, cosine, set(1.0F));
  // Quarter q turns (cos, sin) by q right angles.
  const Ints q = hn::ConvertTo(di, quarter);
  const auto swap = hn::RebindMask(d, hn::Ne(q & hn::Set(di, 1), hn::Zero(di)));
  const Floats s = hn::IfThenElse(swap, cosine, sine);
  const Floats c = hn::IfThenElse(swap, sine, cosine);
  const Ints sign_of_s = hn::ShiftLeft<30>(q & hn::Set(di, 2));
  const Ints sign_of_c = hn::ShiftLeft<30>((q + hn::Set(di, 1)) & hn::Set(di, 2));
  return {s ^ hn::BitCast(d, sign_of_s), c ^ hn::BitCast(d, sign_of_c)};
}

// atan2(y, x) / 2 pi, wrapped to [0, 1), to 1e-7; 0 where both are 0. The quotient t of the smaller
// and the larger is brought below tan(pi/8) by atan t = pi/4 + atan((t - 1) / (t + 1)).
HWY_INLINE Floats atan2_turns(Floats y, Floats x) {
  const Floats ax = hn::Abs(x), ay = hn::Abs(y);
  const Floats t = hn::Min(ax, ay) / hn::Max(hn::Max(ax, ay), set(1e-30F));
  const Mask far = t > 0.41421356F;
  const Floats r = hn::IfThenElse(far, (t - 1) / (t + 1), t);
  const Floats r2 = r * r;
  Floats series = mul_add(r2, set(1.0F / 17), set(-1.0F / 15));
  for (const float term : {1.0F / 13, -1.0F / 11, 1.0F / 9, -1.0F / 7, 1.0F / 5, -1.0F / 3, 1.0F}) {
    series = mul_add(r2, series, set(term));
  }
  Floats turn = r * series * (0.5F * std::numbers::inv_pi_v<float>);
  turn += hn::IfThenElseZero(far, set(0.125F));
  turn = hn::IfThenElse(ay > ax, 0.25F - turn, turn);
  turn = hn::IfThenElse(x < 0, 0.5F - turn, turn);
  return hn::IfThenElse(y < 0, 1 - turn, turn);
}

HWY_INLINE Ints to_int(Floats v) {
  return hn::ConvertTo(IntTag(), v);
}
HWY_INLINE Floats to_float(Ints v) {
  return hn::ConvertTo(FloatTag(), v);
}
HWY_INLINE Floats mix(Floats a, Floats b, Floats t) {
  return mul_add(t, b - a, a);
}
HWY_INLINE Floats gather(const float* table, Ints index) {
  return hn::GatherIndex(FloatTag(), table, index);
}

// Three-vectors.
struct Vectors {
  Floats x, y, z;
};

HWY_INLINE Vectors set(Vec3f v) {
  return {set(v.x), set(v.y), set(v.z)};
}
HWY_INLINE Vectors operator+(Vectors a, Vectors b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
HWY_INLINE Vectors operator-(Vectors a, Vectors b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
HWY_INLINE Vectors operator*(Vectors a, Floats s) {
  return {a.x * s, a.y * s, a.z * s};
}
HWY_INLINE Floats dot(Vectors a, Vectors b) {
  return mul_add(a.z, b.z, mul_add(a.y, b.y, a.x * b.x));
}
HWY_INLINE Vectors cross(Vectors a, Vectors b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
// Brings vectors whose length is 1 but for rounding to that length: a step of Newton's method for 1
// / length.
HWY_INLINE Vectors renormalize(Vectors a) {
  return a * mul_add(set(-0.5F), dot(a, a), set(1.5F));
}
HWY_INLINE Vectors normalize(Vectors a) {
  return a * (1 / hn::Sqrt(dot(a, a)));
}
HWY_INLINE Vectors if_then_else(Mask mask, Vectors a, Vectors b) {
  return {hn::IfThenElse(mask, a.x, b.x), hn::IfThenElse(mask, a.y, b.y),
          hn::IfThenElse(mask, a.z, b.z)};
}

// The other two vectors of an orthonormal basis whose third is n (see Basis in common/vec.h).
struct Tangents {
  Vectors s, t;
};
HWY_INLINE Tangents tangents_of(Vectors n) {
  const Floats sign = hn::CopySign(set(1.0F), n.z);
  const Floats a = -1 / (sign + n.z);
  const Floats b = n.x * n.y * a;
  const Floats n_xa = n.x * a, n_ya = n.y * a;
  return {{mul_add(sign * n.x, n_xa, set(1.0F)), sign * b, -(sign * n.x)},
          {b, mul_add(n.y, n_ya, sign), -n.y}};
}
// (x, y, z) in that basis, and back.
HWY_INLINE Vectors frame_to_world(Vectors n, Floats x, Floats y, Floats z) {
  const auto [s, t] = tangents_of(n);
  const auto sum = [&](Floats sx, Floats tx, Floats nx) {
    return mul_add(nx, z, mul_add(tx, y, sx * x));
  };
  return {sum(s.x, t.x, n.x), sum(s.y, t.y, n.y), sum(s.z, t.z, n.z)};
}
HWY_INLINE Vectors world_to_frame(Vectors n, Vectors v) {
  const auto [s, t] = tangents_of(n);
  return {dot(s, v), dot(t, v), dot(n, v)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
