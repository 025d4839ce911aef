// Looks up depths, and normals, at many points at a time.
#if defined(ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_
#undef ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_
#else
#define ITN_TRACER_GEOMETRY_DEPTH_GRID_INL_H_
#endif

#include <cstdint>

#include "server/tracer/geometry/cell_normals.h"
#include "server/tracer/geometry/cubic_cells.h"
#include "server/tracer/geometry/depth_grid.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The cells where points are, or nearest to them, by number.
HWY_INLINE Ints cells_at(const CubicCells& cells, Vectors x) {
  const IntTag di;
  const auto per_edge = static_cast<float>(1 / cells.edge);
  const auto cell = [&](Floats position, double low, int size) {
    const Floats place = (position - static_cast<float>(low)) * per_edge;
    return hn::ConvertTo(di,
                         hn::Clamp(place, hn::Zero(FloatTag()), set(static_cast<float>(size - 1))));
  };
  const auto [nx, ny, nz] = cells.size;
  const Vec3d& low = cells.low;
  const Ints row = cell(x.z, low.z, nz) * hn::Set(di, ny) + cell(x.y, low.y, ny);
  return row * hn::Set(di, nx) + cell(x.x, low.x, nx);
}

// DepthGrid::quantized of cells.
HWY_INLINE Floats quantized_depth(const DepthGrid& depth_grid, Ints cells) {
  const IntTag di;
  const auto* const words = reinterpret_cast<const int32_t*>(depth_grid.quantized.data());
  const Ints word = hn::GatherIndex(di, words, hn::ShiftRight<2>(cells));
  const Ints shift = hn::ShiftLeft<3>(cells & hn::Set(di, 3));
  return hn::ConvertTo(FloatTag(), hn::Shr(word, shift) & hn::Set(di, 255));
}

// CellNormals::packed of cells.
HWY_INLINE Vectors cell_normal(const CellNormals& normals, Ints cells) {
  const FloatTag d;
  const IntTag di;
  const Ints packed =
      hn::GatherIndex(di, reinterpret_cast<const int32_t*>(normals.packed.data()), cells);
  const auto coordinate = [&](Ints bits) {
    return hn::ConvertTo(d, bits) * (1 / CellNormals::kPackedOne) - 1;
  };
  const Ints low = hn::Set(di, 0xFFFF);
  Vectors n{coordinate(hn::ShiftRight<16>(packed) & low), coordinate(packed & low), hn::Zero(d)};
  n.z = 1 - (hn::Abs(n.x) + hn::Abs(n.y));
  const Floats folded = hn::Max(-n.z, hn::Zero(d));
  n.x -= hn::CopySign(folded, n.x);
  n.y -= hn::CopySign(folded, n.y);
  return normalize(n);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
