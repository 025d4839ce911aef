// How deep below the boundary points of the medium lie, roughly. Internal to the tracer.
//
// Walks that have strayed deep into the medium bring little light home. This tells roulette so; as
// roulette is fair at any odds, the depth need not be exact.
#pragma once

#include <cstdint>
#include <stop_token>
#include <vector>

#include "server/tracer/geometry/cubic_cells.h"

namespace itn::tracer {

struct DepthGrid {
  // Throws Error (cancelled) soon after a stop is asked for.
  explicit DepthGrid(const Mesh& mesh, const std::stop_token& stop = {});

  CubicCells cells;
  // By cell: the distance to the nearest cell that the boundary passes through, from middle to
  // middle, in thirds of an edge, at most 255. By steps to neighbouring cells, so up to a tenth too
  // long or a twentieth too short. (Three spare bytes, as they are read four at a time.)
  std::vector<uint8_t> quantized;

  // Cells along the longest side of the mesh: about as fine as light falls off in the paper's
  // materials, yet all of them fit into a processor's second cache.
  static constexpr int kCells = 64;

  size_t memory() const { return quantized.size(); }
  static constexpr size_t most_memory() { return size_t{kCells} * kCells * kCells + 3; }
};

}  // namespace itn::tracer
