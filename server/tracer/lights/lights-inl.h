// The lights of server/tracer/lights/lights.h, for many directions at a time.
#if defined(ITN_TRACER_WAVEFRONT_LIGHTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_LIGHTS_INL_H_
#undef ITN_TRACER_WAVEFRONT_LIGHTS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_LIGHTS_INL_H_
#endif

#include "server/tracer/lights/light_tables.h"
#include "server/tracer/wavefront/random-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Ints to_int(Floats v) {
  return hn::ConvertTo(IntTag(), v);
}
HWY_INLINE Floats to_float(Ints v) {
  return hn::ConvertTo(FloatTag(), v);
}
HWY_INLINE Floats mix(Floats a, Floats b, Floats t) {
  return plus_product(a, t, hn::Sub(b, a));
}
HWY_INLINE Floats gather(const float* table, Ints index) {
  return hn::GatherIndex(FloatTag(), table, index);
}

// What arrives from directions: radiance, and the density per steradian with which they are drawn.
struct Arrival {
  Floats radiance, density;
};

// Drawn from an alias table: i of n, unless a coin turns it into another.
HWY_INLINE Ints draw(const AliasTable::Entry* entries, Ints i, Floats coin) {
  static_assert(sizeof(AliasTable::Entry) == 2 * sizeof(float));
  const auto* words = reinterpret_cast<const int32_t*>(entries);
  const Ints at = hn::Add(i, i);
  const Floats own = hn::BitCast(FloatTag(), hn::GatherIndex(IntTag(), words, at));
  const Ints other = hn::GatherIndex(IntTag(), words + 1, at);
  return hn::IfThenElse(hn::RebindMask(IntTag(), hn::Lt(coin, own)), i, other);
}

// SkySource: radiance and density of directions.
HWY_INLINE Arrival arrival(const LightTables::Sky& sky, Vectors d) {
  constexpr int kColumns = SkySource::kColumns, kRows = SkySource::kRows;
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
      mix(mix(gather(sky.values, here), gather(sky.values, beside), fx),
          mix(gather(sky.values + kColumns, here), gather(sky.values + kColumns, beside), fx), fy);

  const Floats cell = plus_product(hn::Floor(hn::Mul(column, set(1.0F / SkySource::kMerged))),
                                   hn::Floor(hn::Mul(row, set(1.0F / SkySource::kMerged))),
                                   set(static_cast<float>(SkySource::kCellColumns)));
  const Floats probability = gather(sky.probabilities, to_int(cell));
  const Floats rest = hn::Sub(one, fraction);
  const Floats stretch = plus_product(hn::Mul(fraction, fraction), rest, rest);
  const Floats density = hn::Mul(
      hn::Mul(hn::Mul(probability, stretch),
              set(sky.probability * (SkySource::kCellColumns / 4.0F) * SkySource::kCellRows)),
      per_below);
  const Mask up = hn::Ge(d.y, zero);
  return {hn::IfThenElseZero(up, radiance), hn::IfThenElseZero(up, density)};
}

HWY_INLINE Vectors sample(const LightTables::Sky& sky, Floats cell01, Floats coin, Floats u0,
                          Floats u1) {
  constexpr float kColumns = SkySource::kCellColumns, kRows = SkySource::kCellRows;
  const Floats one = set(1.0F), zero = hn::Zero(FloatTag());
  const Floats cell =
      to_float(draw(sky.entries, to_int(hn::Mul(cell01, set(kColumns * kRows))), coin));
  const Floats row = hn::Floor(hn::Mul(cell, set(1 / kColumns)));
  const Floats column = hn::Sub(cell, hn::Mul(row, set(kColumns)));
  const Floats a = hn::Mul(hn::Add(column, u0), set(4 / kColumns));
  const Floats s = hn::Mul(hn::Add(row, u1), set(1 / kRows));
  const Floats side = hn::Min(hn::Floor(a), set(3.0F));
  const Floats f = hn::Sub(a, side), rest = hn::Sub(one, f);
  const Floats y = hn::Min(one, hn::Mul(s, hn::Sub(set(2.0F), s)));
  const Floats r = hn::Mul(
      hn::Sub(one, s), hn::Sqrt(hn::Div(hn::Add(one, y), plus_product(hn::Mul(f, f), rest, rest))));
  const Floats rf = hn::Mul(r, f), rr = hn::Mul(r, rest);
  // Quarter turns of (r f, -r (1 - f)).
  const Mask odd = hn::Or(hn::Eq(side, one), hn::Eq(side, set(3.0F)));
  const Mask left = hn::Ge(side, set(2.0F));
  const Mask back = hn::And(hn::Ge(side, one), hn::Lt(side, set(3.0F)));  // z >= 0
  const Floats x = hn::IfThenElse(odd, rr, rf), z = hn::IfThenElse(odd, rf, rr);
  return {hn::IfThenElse(left, hn::Sub(zero, x), x), y, hn::IfThenElse(back, z, hn::Sub(zero, z))};
}

// ConeSource.
HWY_INLINE Arrival arrival(const LightTables::Cone& cone, Vectors d) {
  const Vectors off = d - set(cone.basis.n);
  const Mask inside = hn::Le(hn::Mul(set(0.5F), dot(off, off)), set(cone.one_minus_cos));
  return {hn::IfThenElseZero(inside, set(cone.radiance)),
          hn::IfThenElseZero(inside, set(cone.density))};
}

HWY_INLINE Vectors sample(const LightTables::Cone& cone, Floats u0, Floats u1) {
  const Floats z = hn::Mul(u0, set(cone.one_minus_cos));
  const Floats sin_theta = hn::Sqrt(hn::Mul(z, hn::Sub(set(2.0F), z)));
  const SinCos phi = sin_cos_of_turn(u1);
  const Floats x = hn::Mul(sin_theta, phi.cos), y = hn::Mul(sin_theta, phi.sin);
  return renormalize(set(cone.basis.s) * x + set(cone.basis.t) * y +
                     set(cone.basis.n) * hn::Sub(set(1.0F), z));
}

// MapSource.
HWY_INLINE Arrival arrival(const LightTables::Map& map, Vectors d) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  const Floats width = set(static_cast<float>(map.width));
  const Floats height = set(static_cast<float>(map.height));
  Floats u = hn::Add(turn_of(d.x, hn::Neg(d.z)), set(map.rotation01));
  u = hn::Sub(u, hn::Floor(u));
  const Floats across = hn::Sqrt(plus_product(hn::Mul(d.x, d.x), d.z, d.z));
  const Floats v = hn::Mul(set(2.0F), turn_of(across, d.y));

  const Floats x = hn::Sub(hn::Mul(u, width), set(0.5F)),
               y = hn::Sub(hn::Mul(v, height), set(0.5F));
  const Floats column = hn::Floor(x), row = hn::Floor(y);
  const Floats fx = hn::Sub(x, column), fy = hn::Sub(y, row);
  const auto wrapped = [&](Floats c) {
    c = hn::IfThenElse(hn::Lt(c, zero), hn::Add(c, width), c);
    return to_int(hn::IfThenElse(hn::Ge(c, width), hn::Sub(c, width), c));
  };
  const auto start = [&](Floats r) {
    return hn::Mul(to_int(hn::Clamp(r, zero, hn::Sub(height, one))), hn::Set(IntTag(), map.width));
  };
  const Ints c0 = wrapped(column), c1 = wrapped(hn::Add(column, one));
  const Ints r0 = start(row), r1 = start(hn::Add(row, one));
  const auto value = [&](Ints r, Ints c) { return gather(map.values, hn::Add(r, c)); };
  const Floats radiance =
      mix(mix(value(r0, c0), value(r0, c1), fx), mix(value(r1, c0), value(r1, c1), fx), fy);

  const Floats pixel_row = hn::Clamp(hn::Floor(hn::Mul(v, height)), zero, hn::Sub(height, one));
  const Ints pixel_column = to_int(hn::Min(hn::Floor(hn::Mul(u, width)), hn::Sub(width, one)));
  const Floats probability = gather(map.probabilities, hn::Add(start(pixel_row), pixel_column));
  const Floats density = hn::Mul(hn::Mul(probability, set(map.probability)),
                                 gather(map.inverse_angles.data(), to_int(pixel_row)));
  return {radiance, density};
}

HWY_INLINE Vectors sample(const LightTables::Map& map, const Words& words, Floats u0, Floats u1) {
  // A pixel of n from 64 bits: the upper half of their product with n.
  const auto n = static_cast<uint32_t>(map.width) * static_cast<uint32_t>(map.height);
  const WideProduct high = multiply(words.w[0], n), low = multiply(words.w[1], n);
  const Uints sum = hn::Add(high.low, low.high);
  const Uints carry = hn::IfThenElseZero(hn::Lt(sum, high.low), set(uint32_t{1}));
  const Ints first = hn::BitCast(IntTag(), hn::Add(high.high, carry));
  const Ints pixel = draw(map.entries, first, uniform(words.w[2]));
  // Row and column by a division that rounding may have put off by one.
  const Ints width = hn::Set(IntTag(), map.width), one = hn::Set(IntTag(), 1);
  Ints row = to_int(hn::Mul(to_float(pixel), set(1.0F / static_cast<float>(map.width))));
  Ints column = hn::Sub(pixel, hn::Mul(row, width));
  const auto under = hn::Lt(column, hn::Zero(IntTag()));
  row = hn::IfThenElse(under, hn::Sub(row, one), row);
  column = hn::IfThenElse(under, hn::Add(column, width), column);
  const auto over = hn::Not(hn::Lt(column, width));
  row = hn::IfThenElse(over, hn::Add(row, one), row);
  column = hn::IfThenElse(over, hn::Sub(column, width), column);

  Floats turn =
      hn::Sub(hn::Mul(hn::Add(to_float(column), u0), set(1.0F / static_cast<float>(map.width))),
              set(map.rotation01));
  turn = hn::Sub(turn, hn::Floor(turn));
  const Floats y = mix(gather(map.edges.data(), row), gather(map.edges.data() + 1, row), u1);
  const Floats r = hn::Sqrt(
      hn::Max(hn::Zero(FloatTag()), hn::Mul(hn::Sub(set(1.0F), y), hn::Add(set(1.0F), y))));
  const SinCos azimuth = sin_cos_of_turn(turn);
  return renormalize({hn::Mul(r, azimuth.sin), y, hn::Neg(hn::Mul(r, azimuth.cos))});
}

// All lights but beams.
HWY_INLINE Arrival arrival(const LightTables& lights, Vectors d) {
  Arrival all{set(lights.uniform_radiance), set(lights.uniform_density)};
  const auto add = [&](const Arrival& a) {
    all.radiance = hn::Add(all.radiance, a.radiance);
    all.density = hn::Add(all.density, a.density);
  };
  for (const auto& sky : lights.skies) {
    add(arrival(sky, d));
  }
  for (const auto& cone : lights.cones) {
    add(arrival(cone, d));
  }
  for (const auto& map : lights.maps) {
    add(arrival(map, d));
  }
  return all;
}

// Directions towards the light. For beams, `density` is 0 and `radiance` is irradiance /
// probability, the weight of the draw; else the weight is radiance / density.
struct LightDraw {
  Vectors direction;
  Floats radiance, density;
};

// From the words of one counter, and of another one where there is a map. The lower bytes of the
// first three words are left for a fifth uniform number.
HWY_INLINE LightDraw sample(const LightTables& lights, const Words& words, const Words& more) {
  const Floats choice = uniform(words.w[0]), cell = uniform(words.w[1]), coin = uniform(words.w[2]);
  const Floats u0 = coarse_uniform(hn::ShiftRight<16>(words.w[3]));
  const Floats u1 = coarse_uniform(hn::And(words.w[3], set(uint32_t{0xFFFF})));
  const Floats zero = hn::Zero(FloatTag());
  LightDraw draw{{zero, set(1.0F), zero}, zero, zero};
  Floats beam_weight = zero;
  Floats from = set(-1.0F);
  for (const LightTables::Light& light : lights.lights) {
    const Floats to = set(light.cumulative);
    const Mask chosen = hn::And(hn::Ge(choice, from), hn::Lt(choice, to));
    from = to;
    if (hn::AllFalse(FloatTag(), chosen)) {
      continue;
    }
    Vectors direction = draw.direction;
    switch (light.kind) {
      case LightTables::Kind::kUniform: {
        const Floats y = hn::Sub(set(1.0F), hn::Add(u0, u0));
        const Floats r = hn::Sqrt(hn::Max(zero, hn::Sub(set(1.0F), hn::Mul(y, y))));
        const SinCos phi = sin_cos_of_turn(u1);
        direction = {hn::Mul(r, phi.cos), y, hn::Mul(r, phi.sin)};
        break;
      }
      case LightTables::Kind::kCone: direction = sample(lights.cones[light.index], u0, u1); break;
      case LightTables::Kind::kSky:
        direction = sample(lights.skies[light.index], cell, coin, u0, u1);
        break;
      case LightTables::Kind::kMap:
        direction = sample(lights.maps[light.index], more, u0, u1);
        break;
      case LightTables::Kind::kBeam:
        direction = set(lights.beams[light.index].direction);
        beam_weight = hn::IfThenElse(chosen, set(lights.beams[light.index].weight), beam_weight);
        break;
    }
    draw.direction = if_then_else(chosen, direction, draw.direction);
  }
  const Mask beam = hn::Gt(beam_weight, zero);
  const Arrival light = arrival(lights, draw.direction);
  // A direction on the very rim of the sun may fall outside it by rounding.
  const Mask possible = hn::AndNot(beam, hn::Gt(light.density, zero));
  draw.density = hn::IfThenElseZero(possible, light.density);
  draw.radiance = hn::IfThenElse(beam, beam_weight, hn::IfThenElseZero(possible, light.radiance));
  return draw;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
