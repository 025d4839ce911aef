// Straight lines to be followed, and how each of them ended (see RayResult in
// geometry/line_geometry.h).
#pragma once

#include "server/tracer/simd/columns.h"

namespace itn::tracer {

// A shadow ray through more than this many mean free paths carries less than exp(-50) of its light,
// which is below the rounding of any sum it could be added to.
constexpr float kMaxOpticalDepth = 50;

struct Rays {
  // In, and where it ended out (unless it escaped or leaked).
  VectorColumn position, direction;
  // In: what the position is at, see below; out: the end.
  UintColumn interaction{};
  // In: if that is kAtBoundary, the normal of its triangle, outwards.
  VectorColumn normal{};
  // In: the length in the medium to travel at most, in mm.
  FloatColumn max_medium_length{};
  // In, where they are bounded: how far to go at most, in mm, maybe infinite. Who comes as far has
  // escaped, as whoever leaves the scene.
  bool bounded = false;
  FloatColumn distance{};
  // Out: the length travelled inside the medium, in mm; and how the line ended, an End, with
  // kEntered set if it entered the medium, or started in it.
  FloatColumn medium_length{};
  UintColumn outcome{};

  enum End : uint32_t { kInMedium, kSurface, kEscaped, kLeaked, kCrossing };
  static constexpr int kEnteredBit = 3;
  static constexpr uint32_t kEndMask = 7, kEntered = 1 << kEnteredBit;

  // An interaction: bit 0 set inside the medium; bit 1 if a line that stops at the boundary ended
  // there; above them the number of the surface's triangle that the point lies on, plus 1, or 0.
  static constexpr uint32_t kInside = 1, kAtBoundary = 2;
  static constexpr int kSurfaceBit = 2;
  static constexpr uint32_t on_surface(uint32_t triangle) { return (triangle + 1) << kSurfaceBit; }
  static constexpr uint32_t surface_of(uint32_t interaction) {
    return (interaction >> kSurfaceBit) - 1;
  }
};

// Crossings of the boundary that rays end in: the place and the direction are the ray's, and its
// interaction is that before the crossing.
struct Crossings {
  UintColumn triangle{};  // its number in the object's mesh
  // Outward normals of unit length of the triangle and of the smooth surface that it stands for,
  // unless all are flat.
  VectorColumn normal{}, smooth_normal{};
};

// The product of unit normals that face nearly opposite ways is less.
constexpr float kOtherWay = -0.9F;

// What is asked of the rays that are followed: where each ended, or only how, and how long it was.
enum class Report { kEnds, kLengths };

}  // namespace itn::tracer
