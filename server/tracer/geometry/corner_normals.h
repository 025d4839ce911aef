// Normals that change steadily over a mesh which stands for a smooth surface.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/vec.h"

namespace itn::tracer {

class CornerNormals {
 public:
  // Flat triangles.
  CornerNormals() = default;
  // Triangles from a first one on, up to where another range begins, and their smooth angle, in
  // radians.
  struct Range {
    uint32_t first;
    double smooth_angle;
  };
  // Triangles whose normals are less than the smooth angle apart bound one surface where
  // they share a vertex: there, its normal is their mean, weighted by their angles at the vertex
  // (Thuermer, Wuethrich, "Computing vertex normals from polygonal facets", JGT 1998). Vertices of
  // more than kMaxFan triangles are left out, as points of cones are.
  // Throws Error (cancelled) soon after a stop is asked for.
  CornerNormals(const Mesh& mesh, const std::vector<Range>& ranges,
                const std::stop_token& stop = {});
  // The same, but for those of the first triangles, which are given.
  CornerNormals with(const std::vector<std::array<Vec3f, 3>>& given) const {
    CornerNormals result = *this;
    std::ranges::copy(given, result.by_triangle_.begin());
    return result;
  }

  static constexpr size_t kMaxFan = 256;

  bool flat() const { return by_triangle_.empty(); }
  // At barycentric coordinates of the second and third corner, of unit length, outwards; of flat
  // triangles `flat_normal`.
  Vec3f at(uint32_t triangle, float v, float w, Vec3f flat_normal) const {
    if (flat()) return flat_normal;
    const auto& [a, b, c] = by_triangle_[triangle];
    const Vec3f sum = a * (1 - v - w) + b * v + c * w;
    const float squared = dot(sum, sum);
    return squared > kLeastSquare ? sum * (1 / std::sqrt(squared)) : flat_normal;
  }
  // The least square of the length of what is interpolated, where that is a normal.
  static constexpr float kLeastSquare = 0.01F;
  // By triangle, at its three corners.
  const std::vector<std::array<Vec3f, 3>>& by_triangle() const { return by_triangle_; }
  size_t memory() const { return by_triangle_.size() * sizeof(by_triangle_.front()); }

 private:
  std::vector<std::array<Vec3f, 3>> by_triangle_;
};

}  // namespace itn::tracer
