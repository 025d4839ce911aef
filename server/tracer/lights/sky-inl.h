// SkyLight for many directions at a time.
#if defined(ITN_TRACER_LIGHTS_SKY_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_SKY_INL_H_
#undef ITN_TRACER_LIGHTS_SKY_INL_H_
#else
#define ITN_TRACER_LIGHTS_SKY_INL_H_
#endif

#include "server/tracer/lights/light-inl.h"
#include "server/tracer/lights/sky.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Emission emission(const SkyLight& sky, Vectors direction) {
  const SkyTable& table = sky.table();
  const float* const values = table.values();
  const Vectors d = sky.is_turned() ? rotated(sky.to_sky(), direction) : direction;
  constexpr int kColumns = SkyTable::kColumns, kRows = SkyTable::kRows;
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  // Sides 0..3 begin at -z, +x, +z, -x.
  const Floats ax = hn::Abs(d.x), az = hn::Abs(d.z);
  const Floats sum = hn::Max(hn::Add(ax, az), set(1e-12F));
  const Mask right = hn::Ge(d.x, zero), front = hn::Lt(d.z, zero);
  const Mask even = hn::Not(hn::Xor(right, front));  // sides 0 and 2
  const Floats side = hn::IfThenElse(right, hn::IfThenElse(front, zero, one),
                                     hn::IfThenElse(front, set(3.0F), set(2.0F)));
  const Floats below = hn::Sqrt(hn::Sub(one, hn::Clamp(d.y, zero, one)));
  const Floats twice_below = hn::Max(hn::Add(below, below), set(1e-12F));
  // Of both by one division, which is slow.
  const Floats per_both = hn::Div(one, hn::Mul(sum, twice_below));
  const Floats per_sum = hn::Mul(twice_below, per_both), per_below = hn::Mul(sum, per_both);
  const Floats fraction = hn::Min(one, hn::Mul(hn::IfThenElse(even, ax, az), per_sum));
  const Floats x = hn::Mul(hn::Add(side, fraction), set(kColumns / 4.0F));
  const Floats y = hn::Mul(hn::Sub(one, below), set(static_cast<float>(kRows)));
  const Floats column = hn::Min(hn::Floor(x), set(kColumns - 1.0F));
  const Floats row = hn::Min(hn::Floor(y), set(kRows - 1.0F));
  const Floats next =
      hn::IfThenElseZero(hn::Lt(column, set(kColumns - 1.0F)), hn::Add(column, one));
  const Floats start = hn::Mul(row, set(static_cast<float>(kColumns)));
  const Ints here = to_int(hn::Add(start, column)), beside = to_int(hn::Add(start, next));
  const Floats fx = hn::Sub(x, column), fy = hn::Sub(y, row);
  const Floats radiance =
      mix(mix(gather(values, here), gather(values, beside), fx),
          mix(gather(values + kColumns, here), gather(values + kColumns, beside), fx), fy);

  const Floats cell = mul_add(hn::Floor(hn::Mul(row, set(1.0F / SkyTable::kMerged))),
                              set(static_cast<float>(SkyTable::kCellColumns)),
                              hn::Floor(hn::Mul(column, set(1.0F / SkyTable::kMerged))));
  const Floats probability = gather(table.cells().probabilities(), to_int(cell));
  const Floats rest = hn::Sub(one, fraction);
  const Floats stretch = mul_add(rest, rest, hn::Mul(fraction, fraction));
  const Floats pdf = hn::Mul(hn::Mul(hn::Mul(probability, stretch),
                                     set((SkyTable::kCellColumns / 4.0F) * SkyTable::kCellRows)),
                             per_below);
  const Mask up = hn::Ge(d.y, zero);
  return {hn::IfThenElseZero(up, hn::Mul(radiance, set(static_cast<float>(sky.scale())))),
          hn::IfThenElseZero(up, pdf)};
}

HWY_INLINE Vectors sample(const SkyLight& sky, const LightUniforms& u) {
  const auto& [cell01, coin, u0, u1, more] = u;
  constexpr float kColumns = SkyTable::kCellColumns, kRows = SkyTable::kCellRows;
  const Floats one = set(1.0F), zero = hn::Zero(FloatTag());
  const Floats cell = to_float(
      draw(sky.table().cells().entries(), to_int(hn::Mul(cell01, set(kColumns * kRows))), coin));
  const Floats row = hn::Floor(hn::Mul(cell, set(1 / kColumns)));
  const Floats column = hn::Sub(cell, hn::Mul(row, set(kColumns)));
  const Floats a = hn::Mul(hn::Add(column, u0), set(4 / kColumns));
  const Floats s = hn::Mul(hn::Add(row, u1), set(1 / kRows));
  const Floats side = hn::Min(hn::Floor(a), set(3.0F));
  const Floats f = hn::Sub(a, side), rest = hn::Sub(one, f);
  const Floats y = hn::Min(one, hn::Mul(s, hn::Sub(set(2.0F), s)));
  const Floats r = hn::Mul(hn::Sub(one, s),
                           hn::Sqrt(hn::Div(hn::Add(one, y), mul_add(rest, rest, hn::Mul(f, f)))));
  const Floats rf = hn::Mul(r, f), rr = hn::Mul(r, rest);
  // Quarter turns of (r f, -r (1 - f)).
  const Mask odd = hn::Or(hn::Eq(side, one), hn::Eq(side, set(3.0F)));
  const Mask left = hn::Ge(side, set(2.0F));
  const Mask back = hn::And(hn::Ge(side, one), hn::Lt(side, set(3.0F)));  // z >= 0
  const Floats x = hn::IfThenElse(odd, rr, rf), z = hn::IfThenElse(odd, rf, rr);
  const Vectors d{hn::IfThenElse(left, hn::Sub(zero, x), x), y,
                  hn::IfThenElse(back, z, hn::Sub(zero, z))};
  return sky.is_turned() ? rotated_back(sky.to_sky(), d) : d;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
