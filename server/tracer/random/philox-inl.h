// The random numbers of server/tracer/random/sampler.h, many at a time and with the same bits.
#if defined(ITN_TRACER_RANDOM_PHILOX_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_RANDOM_PHILOX_INL_H_
#undef ITN_TRACER_RANDOM_PHILOX_INL_H_
#else
#define ITN_TRACER_RANDOM_PHILOX_INL_H_
#endif

#include "server/tracer/random/sampler.h"
#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

struct WideProduct {
  Uints high, low;
};

// The 64-bit products of 32-bit numbers: those of the even lanes, those of the odd ones, and the
// halves put back where they belong.
HWY_INLINE WideProduct multiply(Uints a, uint32_t constant) {
  const UintTag d;
#if HWY_TARGET == HWY_SCALAR
  const uint64_t product = uint64_t{hn::GetLane(a)} * constant;
  return {hn::Set(d, static_cast<uint32_t>(product >> 32)),
          hn::Set(d, static_cast<uint32_t>(product))};
#else
  const hn::RepartitionToWide<UintTag> wide;
  const Uints c = hn::Set(d, constant);
  const auto even = hn::MulEven(a, c);
  const auto odd = hn::MulEven(hn::BitCast(d, hn::ShiftRight<32>(hn::BitCast(wide, a))), c);
  return {hn::OddEven(hn::BitCast(d, odd), hn::BitCast(d, hn::ShiftRight<32>(even))),
          hn::OddEven(hn::BitCast(d, hn::ShiftLeft<32>(odd)), hn::BitCast(d, even))};
#endif
}

struct Words {
  Uints w[4];
};
HWY_INLINE Words set(const RandomWords& words) {
  return {{set(words[0]), set(words[1]), set(words[2]), set(words[3])}};
}

HWY_INLINE Words philox(Uints c0, Uints c1, Uints c2, Uints c3, uint64_t seed) {
  auto k0 = static_cast<uint32_t>(seed), k1 = static_cast<uint32_t>(seed >> 32);
  for (int round = 0; round < kPhiloxRounds; ++round) {
    const WideProduct a = multiply(c0, 0xD2511F53), b = multiply(c2, 0xCD9E8D57);
    c0 = b.high ^ c1 ^ set(k0);
    c2 = a.high ^ c3 ^ set(k1);
    c1 = b.low;
    c3 = a.low;
    k0 += 0x9E3779B9;
    k1 += 0xBB67AE85;
  }
  return {{c0, c1, c2, c3}};
}

// In [0, 1), multiples of 2^-24.
HWY_INLINE Floats uniform(Uints word) {
  const IntTag di;
  return hn::ConvertTo(FloatTag(), hn::BitCast(di, hn::ShiftRight<8>(word))) * 0x1p-24F;
}

// A fifth number, of the lower 8 bits of three words.
HWY_INLINE Floats fifth_uniform(const Words& words) {
  const Uints byte = set(uint32_t{255});
  const Uints bits = hn::ShiftLeft<16>(words.w[0] & byte) | hn::ShiftLeft<8>(words.w[1] & byte) |
                     (words.w[2] & byte);
  return hn::ConvertTo(FloatTag(), hn::BitCast(IntTag(), bits)) * 0x1p-24F;
}

// The upper or lower half of a word: the middles of 2^16 equal parts of [0, 1).
HWY_INLINE Floats coarse_uniform(Uints half) {
  const Floats k = hn::ConvertTo(FloatTag(), hn::BitCast(IntTag(), half));
  return (k + 0.5F) * 0x1p-16F;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
