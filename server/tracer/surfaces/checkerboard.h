// Squares, or parallelograms, of two reflectances in turn.
#ifndef ITN_TRACER_SURFACES_CHECKERBOARD_H_
#define ITN_TRACER_SURFACES_CHECKERBOARD_H_

#include "server/tracer/colour/channel.h"
#include "server/tracer/surfaces/plane_coordinates.h"

namespace itn::tracer {

struct Checkerboard {
  float even = 0.8F, odd = 0.2F;  // reflectances, that of the square at the corner first
  Vec3d corner;                   // of that square, in mm
  Vec3d edge_u{10, 0, 0}, edge_v{0, 0, 10};
  PlaneCoordinates plane = {};  // once it is compiled

  static constexpr const char* kName = "checkerboard";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("even", self.even, 0, 1);
    to.slot("odd", self.odd, 0, 1);
    to.position("corner", self.corner);
    to.position("edge_u", self.edge_u);
    to.position("edge_v", self.edge_v);
  }
  Checkerboard compile(const Pose& pose, Channel /*channel*/) const {
    Checkerboard compiled = *this;
    compiled.plane = PlaneCoordinates(pose, kName, corner, edge_u, edge_v);
    return compiled;
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_SURFACES_CHECKERBOARD_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SURFACES_CHECKERBOARD_MATHS_
#undef ITN_TRACER_SURFACES_CHECKERBOARD_MATHS_
#else
#define ITN_TRACER_SURFACES_CHECKERBOARD_MATHS_
#endif

#include "server/tracer/simd/math-inl.h"
#include "server/tracer/surfaces/plane_coordinates.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Mask is_even(const Checkerboard& board, Vectors p) {
  const PlanePoint at = coordinates_of(board.plane, p);
  const Floats half = (hn::Floor(at.u) + hn::Floor(at.v)) * 0.5F;
  return hn::Eq(half, hn::Floor(half));
}
HWY_INLINE Floats reflectance_at(const Checkerboard& board, Vectors p) {
  return hn::IfThenElse(is_even(board, p), set(board.even), set(board.odd));
}
HWY_INLINE Floats reflectance_slope(const Checkerboard& board, size_t slot, Vectors p) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  return slot == 0 ? hn::IfThenElse(is_even(board, p), one, zero)
                   : hn::IfThenElse(is_even(board, p), zero, one);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
