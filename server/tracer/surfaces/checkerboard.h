// Squares, or parallelograms, of two reflectances in turn.
#ifndef ITN_TRACER_SURFACES_CHECKERBOARD_H_
#define ITN_TRACER_SURFACES_CHECKERBOARD_H_

#include "common/error.h"
#include "common/geometry/pose.h"

namespace itn::tracer {

struct Checkerboard {
  float even = 0.8F, odd = 0.2F;  // reflectances, that of the square at the corner first
  Vec3d corner;                   // of that square, in mm
  Vec3d edge_u{10, 0, 0}, edge_v{0, 0, 10};
  // Once it is compiled: along what the edges of squares are counted, in 1/mm.
  Vec3d count_u{}, count_v{};

  static constexpr const char* kName = "checkerboard";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("even", self.even, 0, 1);
    to.slot("odd", self.odd, 0, 1);
    to.position("corner", self.corner);
    to.position("edge_u", self.edge_u);
    to.position("edge_v", self.edge_v);
  }
  // count_u is at right angles to edge_v, and 1 along edge_u; and the other way round.
  Checkerboard compile(const Pose& pose) const {
    const Rotation<double> turn = pose.rotation.inverse();
    const Vec3d u = turn(edge_u), v = turn(edge_v), normal = cross(u, v);
    if (!(length(normal) > 1e-6 * length(u) * length(v))) {
      throw invalid_input("checkerboard.edge_u and edge_v are parallel; they must not be");
    }
    const double per = 1 / dot(normal, normal);
    return {
        even, odd, pose.to_object(corner), u, v, cross(v, normal) * per, cross(normal, u) * per};
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

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Mask is_even(const Checkerboard& board, Vectors p) {
  const Vectors from_corner = p - set(static_cast<Vec3f>(board.corner));
  const auto square = [&](Vec3d count) {
    return hn::Floor(dot(from_corner, set(static_cast<Vec3f>(count))));
  };
  const Floats half = hn::Mul(hn::Add(square(board.count_u), square(board.count_v)), set(0.5F));
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
