// The triangles of a boundary that refracts, and which are around each. Internal to the tracer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "common/geometry/mesh.h"

namespace itn::tracer {

struct Facets {
  // None.
  Facets() = default;
  // Throws Error (cancelled) soon after a stop is asked for.
  explicit Facets(const Mesh& mesh, const std::stop_token& stop = {});

  // By triangle. A point of its plane that is p from the corner is in the triangle where dot(p, v)
  // and dot(p, w), and 1 less both, are not negative.
  struct Facet {
    Vec3f corner, normal, v, w;
  };
  std::vector<Facet> by_triangle;
  // Triangle t itself, and those that share an edge with it, and then a vertex, up to kMost:
  // around[first[t]] up to around[first[t + 1]].
  std::vector<uint32_t> first, around;

  static constexpr size_t kMost = 32;

  size_t memory() const {
    return by_triangle.size() * sizeof(Facet) + (first.size() + around.size()) * sizeof(uint32_t);
  }
  // With `triangles`, and while it is computed.
  static constexpr size_t most_memory(size_t triangles) {
    return (sizeof(Facet) + (kMost + 8) * sizeof(uint32_t)) * triangles;
  }
};

}  // namespace itn::tracer
