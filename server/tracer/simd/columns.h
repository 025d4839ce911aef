// Columns of numbers, one for every slot of a wavefront: what is processed many at a time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "common/vec.h"

namespace itn::tracer {

// The widest vectors that are used. Columns may be read and written that far beyond their end.
constexpr size_t kMaxLanes = 16;

// Slots: enough to keep the lanes full, few enough to stay in the nearer caches.
constexpr size_t kSlots = 512;

template <typename T>
struct alignas(64) Column : std::array<T, kSlots + kMaxLanes> {};

using FloatColumn = Column<float>;
using UintColumn = Column<uint32_t>;

struct VectorColumn {
  FloatColumn x{}, y{}, z{};
  void set(size_t slot, Vec3f v) {
    x[slot] = v.x;
    y[slot] = v.y;
    z[slot] = v.z;
  }
  Vec3f at(size_t slot) const { return {x[slot], y[slot], z[slot]}; }
};

}  // namespace itn::tracer
