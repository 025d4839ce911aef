// Looks up depths at many points at a time.
#if defined(ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_
#undef ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_
#else
#define ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_
#endif

#include <cstdint>

#include "server/tracer/geometry/depth_grid.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// DepthGrid::quantized where points are.
HWY_INLINE Floats quantized_depth(const DepthGrid& depth_grid, Vectors x) {
  const IntTag di;
  const auto per_edge = static_cast<float>(1 / depth_grid.cells.edge);
  const auto cell = [&](Floats position, double low, int size) {
    const Floats place = hn::Mul(hn::Sub(position, set(static_cast<float>(low))), set(per_edge));
    return hn::ConvertTo(di,
                         hn::Clamp(place, hn::Zero(FloatTag()), set(static_cast<float>(size - 1))));
  };
  const auto [nx, ny, nz] = depth_grid.cells.size;
  const Vec3d& low = depth_grid.cells.low;
  const Ints row = hn::Add(hn::Mul(cell(x.z, low.z, nz), hn::Set(di, ny)), cell(x.y, low.y, ny));
  const Ints index = hn::Add(hn::Mul(row, hn::Set(di, nx)), cell(x.x, low.x, nx));
  const auto* const words = reinterpret_cast<const int32_t*>(depth_grid.quantized.data());
  const Ints word = hn::GatherIndex(di, words, hn::ShiftRight<2>(index));
  const Ints shift = hn::ShiftLeft<3>(hn::And(index, hn::Set(di, 3)));
  return hn::ConvertTo(FloatTag(), hn::And(hn::Shr(word, shift), hn::Set(di, 255)));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
