// Lines step through the grid, from cell to cell, and over cubes of empty cells at once.
#if defined(ITN_TRACER_GEOMETRY_LINES_GRID_STEPS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_GEOMETRY_LINES_GRID_STEPS_INL_H_
#undef ITN_TRACER_GEOMETRY_LINES_GRID_STEPS_INL_H_
#else
#define ITN_TRACER_GEOMETRY_LINES_GRID_STEPS_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include "server/tracer/geometry/grid.h"
#include "server/tracer/geometry/lines/lines-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// In the grid's coordinates.
HWY_INLINE Vectors in_cells(const Grid& grid, Vectors x) {
  return (x - set(grid.low)) * set(grid.inverse_edge);
}

// Number along an axis of the cell at a distance.
HWY_INLINE Floats cell_at(Floats from, Floats slope, Floats distance, int size) {
  return hn::Clamp(hn::Floor(mul_add(slope, distance, from)), hn::Zero(FloatTag()),
                   set(static_cast<float>(size - 1)));
}

// With 0 for -0: what does not fall is taken to rise, in octants as in steps.
HWY_INLINE Vectors with_positive_zeros(Vectors direction) {
  const Floats zero = hn::Zero(FloatTag());
  return {direction.x + zero, direction.y + zero, direction.z + zero};
}

HWY_INLINE Uints octant_of(Vectors direction) {
  const auto falls = [&](Floats component, uint32_t bit) {
    return hn::IfThenElseZero(for_uints(component < 0), set(bit));
  };
  return falls(direction.x, 1) | falls(direction.y, 2) | falls(direction.z, 4);
}

// What lines know of themselves in the grid's coordinates, in cells. A component of 0 is taken as
// so small that the faces it would cross are never met first.
HWY_INLINE void begin_in_grid(const Grid& grid, Lines& lines, Mask fresh, size_t v, Vectors origin,
                              Vectors direction) {
  const Floats edge = set(grid.edge), tiny = set(1e-20F);
  lines.cells_origin.store(fresh, in_cells(grid, origin), v);
  lines.cells_direction.store(fresh, direction * set(grid.inverse_edge), v);
  const auto mm_per_cell = [&](Floats component) {
    const Floats safe =
        hn::IfThenElse(hn::Abs(component) < tiny, hn::CopySign(tiny, component), component);
    return edge / safe;
  };
  lines.mm_per_cell.store(
      fresh, {mm_per_cell(direction.x), mm_per_cell(direction.y), mm_per_cell(direction.z)}, v);

  store(fresh, octant_of(direction), lines.octant, v);
}

// A cell's word, and the edge of the empty cube ahead of it.
struct CellWords {
  Uints word;
  Floats skip;
};
HWY_INLINE CellWords read_cell(const Grid& grid, Vectors cell, Uints octant) {
  const IntTag di;
  const Floats row = set(static_cast<float>(grid.size[0]));
  const Floats layer = set(static_cast<float>(grid.size[0]) * static_cast<float>(grid.size[1]));
  const Ints index = hn::ConvertTo(di, mul_add(cell.z, layer, mul_add(cell.y, row, cell.x)));
  const auto* const cells = reinterpret_cast<const int32_t*>(grid.cells.data());
  const auto* const skips = reinterpret_cast<const int32_t*>(grid.skips.data());
  const Ints byte = hn::ShiftLeft<3>(index) + hn::BitCast(di, octant);
  const Ints skip = hn::GatherOffset(di, skips, byte) & hn::Set(di, Grid::kMaxSkip);
  return {hn::BitCast(UintTag(), hn::GatherIndex(di, cells, index)),
          hn::ConvertTo(FloatTag(), skip)};
}

// Lines between two distances, where they pass through a cell; for crossings of which side
// (Lines::side).
struct Passage {
  Vectors origin, direction;
  Floats side, from, to;
};

// Which of the lines in occupied cells may cross a triangle there in the direction that they look
// for: not where the cone of the normals shows that all face the other way, nor where the line
// passes the cell on one side of the slab that they lie in.
HWY_INLINE Mask may_cross(const Grid& grid, Uints words, Mask where, Vectors cell,
                          const Passage& line) {
  const FloatTag d;
  const IntTag di;
  constexpr int kStride = sizeof(OccupiedCell) / sizeof(int32_t);
  constexpr size_t kNormals = offsetof(OccupiedCell, normals) / sizeof(int32_t);
  constexpr size_t kSlab = offsetof(OccupiedCell, slab) / sizeof(int32_t);
  const auto* const occupied = reinterpret_cast<const int32_t*>(grid.occupied.data());
  const Ints number =
      hn::BitCast(di, hn::IfThenElseZero(for_uints(where), words & set(Grid::kPayload)));
  const Ints offset = number * hn::Set(di, kStride);
  const Ints cone = hn::GatherIndex(di, occupied + kNormals, offset);
  const auto component = [&](Ints shifted) {
    return hn::ConvertTo(d, hn::ShiftRight<24>(shifted));
  };
  const Vectors axis{component(hn::ShiftLeft<24>(cone)), component(hn::ShiftLeft<16>(cone)),
                     component(hn::ShiftLeft<8>(cone))};
  const auto upper = [&](Ints bits, auto shift) {
    return hn::ConvertTo(d, hn::BitCast(di, shift(hn::BitCast(UintTag(), bits))));
  };
  const Floats threshold = upper(cone, [](Uints bits) { return hn::ShiftRight<24>(bits); });
  const Floats slope = dot(line.direction, axis);
  const Mask faces = where & (-(slope * line.side) < threshold);

  // a . (x - middle) at both ends.
  const Floats half = set(0.5F), edge = set(grid.edge);
  const Vectors middle{mul_add(cell.x + half, edge, set(grid.low.x)),
                       mul_add(cell.y + half, edge, set(grid.low.y)),
                       mul_add(cell.z + half, edge, set(grid.low.z))};
  const Floats at_origin = dot(line.origin - middle, axis);
  const Floats first = mul_add(slope, line.from, at_origin);
  const Floats last = mul_add(slope, line.to, at_origin);
  const Ints slab = hn::GatherIndex(di, occupied + kSlab, offset);
  const Floats scale = set(grid.slab_scale), per_unit = set(2.0F / 65535 * grid.slab_scale);
  const Floats high =
      upper(slab, [](Uints bits) { return hn::ShiftRight<16>(bits); }) * per_unit - scale;
  const Floats low =
      upper(slab, [](Uints bits) { return bits & set(uint32_t{0xFFFF}); }) * per_unit - scale;
  const Mask reaches = (hn::Max(first, last) >= low) & (hn::Min(first, last) <= high);
  return faces & reaches;
}

// Puts lines into the cell where their query begins, between t_min and end; returns those that meet
// the grid there.
HWY_INLINE Mask enter_grid(const Grid& grid, Lines& lines, Mask where, size_t v, Floats t_min,
                           Floats end) {
  // Clip to the grid.
  const Vectors x0 = lines.cells_origin.load(v), dx = lines.cells_direction.load(v);
  const Vectors mm = lines.mm_per_cell.load(v);
  Floats near = t_min, far = end;
  const auto clip = [&](Floats from, Floats scale, int size) {
    const Floats a = -from * scale;
    const Floats b = (static_cast<float>(size) - from) * scale;
    near = hn::Max(near, hn::Min(a, b));
    far = hn::Min(far, hn::Max(a, b));
  };
  clip(x0.x, mm.x, grid.size[0]);
  clip(x0.y, mm.y, grid.size[1]);
  clip(x0.z, mm.z, grid.size[2]);
  lines.cell.store(
      where,
      {cell_at(x0.x, dx.x, near, grid.size[0]), cell_at(x0.y, dx.y, near, grid.size[1]),
       cell_at(x0.z, dx.z, near, grid.size[2])},
      v);
  store(where, near, lines.entered_cell, v);
  store(where, far, lines.grid_end, v);
  return where & (near <= far);
}

// Reads the words of the cells of lines that are stepping; returns those lines that have triangles
// to test there.
HWY_INLINE Mask read_cells(const Grid& grid, Lines& lines, Mask stepping, size_t v) {
  const Vectors cell = lines.cell.load(v);
  const auto [word, skip] = read_cell(grid, cell, load(lines.octant, v));
  store(stepping, word, lines.word, v);
  store(skip, lines.skip, v);
  const Mask occupied = stepping & not_zero(word & set(Grid::kOccupied));
  if (hn::AllFalse(FloatTag(), occupied)) return occupied;
  // Find where the lines leave the cell, or end.
  const Vectors x0 = lines.cells_origin.load(v), dx = lines.cells_direction.load(v);
  const Vectors mm = lines.mm_per_cell.load(v);
  const auto leave = [&](Floats c, Floats from, Floats rate, Floats scale) {
    const Floats face = hn::IfThenElseZero(rate >= 0, set(1.0F));
    return (c - from + face) * scale;
  };
  const Floats out =
      hn::Min(hn::Min(leave(cell.x, x0.x, dx.x, mm.x), load(lines.grid_end, v)),
              hn::Min(leave(cell.y, x0.y, dx.y, mm.y), leave(cell.z, x0.z, dx.z, mm.z)));
  const Passage passage{lines.origin.load(v), lines.direction.load(v), load(lines.side, v),
                        load(lines.entered_cell, v), out};
  return may_cross(grid, word, occupied, cell, passage);
}

// A step leaves the cube of empty cells ahead (an occupied cell alone) through the face that the
// line meets first. The index along that axis is set from the cube, so every step makes progress
// however the distance is rounded; the others follow from the position. Returns the lines whose
// query goes on.
HWY_INLINE Mask advance(const Grid& grid, Lines& lines, Mask stepping, size_t v) {
  const FloatTag d;
  const Vectors x0 = lines.cells_origin.load(v), dx = lines.cells_direction.load(v);
  const Vectors mm = lines.mm_per_cell.load(v), cell = lines.cell.load(v);
  const Floats zero = hn::Zero(d), skip = load(lines.skip, v);
  // Cells from here to the face that the line leaves through.
  const auto to_face = [&](Floats slope) { return hn::IfThenElse(slope < 0, 1 - skip, skip); };
  const auto leave = [&](Floats c, Floats from, Floats slope, Floats scale) {
    return (c - from + to_face(slope)) * scale;
  };
  const Floats leave_x = leave(cell.x, x0.x, dx.x, mm.x);
  const Floats leave_y = leave(cell.y, x0.y, dx.y, mm.y);
  const Floats leave_z = leave(cell.z, x0.z, dx.z, mm.z);
  const Floats t = hn::Min(leave_x, hn::Min(leave_y, leave_z));
  const Mask ended = t >= hn::Min(load(lines.hit, v), load(lines.grid_end, v));

  const Mask along_x = hn::Eq(t, leave_x);
  const Mask along_y = hn::AndNot(along_x, hn::Eq(t, leave_y));
  const Mask along_z = !(along_x | along_y);
  const Floats before = skip - 1;
  const auto move = [&](Mask along, Floats c, Floats from, Floats slope, int size) {
    // The cells of the cube ahead, within the grid.
    const Floats far =
        hn::Clamp(c + hn::CopySign(before, slope), zero, set(static_cast<float>(size - 1)));
    const Floats low = hn::Min(c, far), high = hn::Max(c, far);
    const Floats follow = hn::Clamp(hn::Floor(mul_add(slope, t, from)), low, high);
    return hn::IfThenElse(along, c + hn::CopySign(skip, slope), follow);
  };
  const Vectors next{move(along_x, cell.x, x0.x, dx.x, grid.size[0]),
                     move(along_y, cell.y, x0.y, dx.y, grid.size[1]),
                     move(along_z, cell.z, x0.z, dx.z, grid.size[2])};
  const auto within = [&](Floats c, int size) { return (c >= 0) & (c < static_cast<float>(size)); };
  const Mask in_grid =
      within(next.x, grid.size[0]) & within(next.y, grid.size[1]) & within(next.z, grid.size[2]);
  const Mask goes_on = stepping & hn::AndNot(ended, in_grid);
  lines.cell.store(goes_on, next, v);
  store(t, lines.entered_cell, v);
  return goes_on;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
