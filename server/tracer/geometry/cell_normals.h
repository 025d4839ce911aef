// Which way the boundary faces where it is nearest, roughly. Internal to the tracer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "common/geometry/mesh.h"
#include "server/tracer/geometry/depth_grid.h"

namespace itn::tracer {

struct CellNormals {
  // None.
  CellNormals() = default;
  // Throws Error (cancelled) soon after a stop is asked for.
  CellNormals(const Mesh& mesh, const DepthGrid& depth_grid, const std::stop_token& stop = {});

  // By cell of the depth grid: the normal, outwards, of the boundary in the nearest cell that it
  // passes through. There, the mean over the triangles within kOneSurface of the one that has most
  // of its area in the cell, as the mean of two sides of an edge faces neither way. A unit vector
  // on an octahedron unfolded into a square, 16 bits along each side (Cigolle et al., "A survey of
  // efficient representations for independent unit vectors", JCGT 2014).
  std::vector<uint32_t> packed;

  static constexpr float kOneSurface = 0.7F;  // cosine
  static constexpr float kPackedOne = 32767;  // the middle of a side, and half its length

  size_t memory() const { return packed.size() * sizeof(packed.front()); }
  // The most memory that is taken while they are computed.
  static constexpr size_t most_memory() { return 32 * DepthGrid::most_memory(); }
};

}  // namespace itn::tracer
