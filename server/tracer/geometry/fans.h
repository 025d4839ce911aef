// The triangles at every vertex of a mesh.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace itn::tracer {

// One vertex after the other: those of vertex v are triangles[first[v]] up to
// triangles[first[v + 1]].
struct Fans {
  std::vector<uint32_t> first, triangles;

  explicit Fans(const Mesh& mesh) : first(mesh.vertices.size() + 1) {
    for (const auto& corners : mesh.triangles) {
      for (const uint32_t vertex : corners) ++first[vertex + 1];
    }
    for (size_t v = 1; v < first.size(); ++v) first[v] += first[v - 1];
    triangles.resize(first.back());
    std::vector<uint32_t> next(first.begin(), first.end() - 1);
    for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      for (const uint32_t vertex : mesh.triangles[t]) triangles[next[vertex]++] = t;
    }
  }
};

}  // namespace itn::tracer
