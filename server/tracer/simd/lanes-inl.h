// Masks, sets and columns, a vector at a time.
#if defined(ITN_TRACER_SIMD_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SIMD_LANES_INL_H_
#undef ITN_TRACER_SIMD_LANES_INL_H_
#else
#define ITN_TRACER_SIMD_LANES_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/tracer/simd/columns.h"
#include "server/tracer/simd/math-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// A set of at most 64 slots or lines, a bit each.
using Bits = uint64_t;

// The members of a set that are in the vector that begins with number v; and the other way round.
HWY_INLINE Mask mask_of(Bits bits, size_t v) {
  bits >>= v;
  const uint8_t bytes[8] = {static_cast<uint8_t>(bits), static_cast<uint8_t>(bits >> 8)};
  return hn::LoadMaskBits(FloatTag(), bytes);
}
HWY_INLINE Bits bits_of(Mask mask, size_t v = 0) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(FloatTag(), mask, bytes);
  return (bytes[0] | static_cast<Bits>(bytes[1]) << 8) << v;
}
// Whether any of that vector's is in the set.
HWY_INLINE bool any_set(Bits bits, size_t v) {
  return (bits >> v & ((Bits{1} << lanes()) - 1)) != 0;
}

HWY_INLINE Mask not_zero(Uints v) {
  return hn::RebindMask(FloatTag(), hn::Ne(v, hn::Zero(UintTag())));
}
HWY_INLINE hn::Mask<UintTag> for_uints(Mask mask) {
  return hn::RebindMask(UintTag(), mask);
}
HWY_INLINE Mask equals(Uints v, uint32_t constant) {
  return hn::RebindMask(FloatTag(), hn::Eq(v, set(constant)));
}

// Columns, from number i on.
HWY_INLINE Floats load(const FloatColumn& column, size_t i) {
  return hn::Load(FloatTag(), column.data() + i);
}
HWY_INLINE Uints load(const UintColumn& column, size_t i) {
  return hn::Load(UintTag(), column.data() + i);
}
HWY_INLINE Vectors load(const VectorColumn& column, size_t i) {
  return {load(column.x, i), load(column.y, i), load(column.z, i)};
}
HWY_INLINE void store(Floats v, FloatColumn& column, size_t i) {
  hn::Store(v, FloatTag(), column.data() + i);
}
HWY_INLINE void store(Uints v, UintColumn& column, size_t i) {
  hn::Store(v, UintTag(), column.data() + i);
}
HWY_INLINE void store(Vectors v, VectorColumn& column, size_t i) {
  store(v.x, column.x, i);
  store(v.y, column.y, i);
  store(v.z, column.z, i);
}
// Columns, at any numbers.
HWY_INLINE Floats gather(const FloatColumn& column, Ints at) {
  return hn::GatherIndex(FloatTag(), column.data(), at);
}
HWY_INLINE Uints gather(const UintColumn& column, Ints at) {
  return hn::GatherIndex(UintTag(), column.data(), at);
}
HWY_INLINE Vectors gather(const VectorColumn& column, Ints at) {
  return {gather(column.x, at), gather(column.y, at), gather(column.z, at)};
}

// Columns at any slots, all different but for the spare one.
struct SlotGather {
  Ints slots;
  template <typename Column>
  HWY_INLINE auto get(const Column& column) const {
    return gather(column, slots);
  }
  HWY_INLINE void add(Floats by, FloatColumn& column) const {
    hn::ScatterIndex(get(column) + by, FloatTag(), column.data(), slots);
  }
};

// Puts those of some lanes behind one another, from number `first` on.
struct Append {
  Mask where;
  size_t first;
  HWY_INLINE void operator()(Floats v, FloatColumn& column) const {
    hn::CompressStore(v, where, FloatTag(), column.data() + first);
  }
  HWY_INLINE void operator()(Vectors v, VectorColumn& column) const {
    (*this)(v.x, column.x);
    (*this)(v.y, column.y);
    (*this)(v.z, column.z);
  }
  HWY_INLINE void operator()(Uints v, UintColumn& column) const {
    hn::CompressStore(v, for_uints(where), UintTag(), column.data() + first);
  }
  // The numbers that they get.
  HWY_INLINE Uints numbers() const {
    alignas(64) uint32_t number[kMaxLanes] = {};
    auto next = static_cast<uint32_t>(first);
    for (Bits bits = bits_of(where); bits != 0; bits &= bits - 1) {
      number[std::countr_zero(bits)] = next++;
    }
    return hn::Load(UintTag(), number);
  }
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
