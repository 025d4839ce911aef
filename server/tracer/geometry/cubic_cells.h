// Space cut into equal cubes, and which of them a triangle touches. Internal to the tracer.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "common/cancellation.h"
#include "common/geometry/mesh.h"

namespace itn::tracer {

struct CubicCells {
  Vec3d low;  // corner
  double edge = 1;
  std::array<int, 3> size{1, 1, 1};  // in cells

  size_t count() const { return static_cast<size_t>(size[0]) * size[1] * size[2]; }
  // x fastest.
  size_t index(int x, int y, int z) const {
    return (static_cast<size_t>(z) * size[1] + y) * size[0] + x;
  }
};

// How many cells the triangles of a mesh touch, each triangle counted for itself: the mean over all
// places of the grid, by the volume of the sum of a triangle and a cube. So what a grid costs is
// known before it is built, and how far it must be coarsened, however thin or large triangles are.
class ExpectedTouches {
 public:
  ExpectedTouches(const Mesh& mesh, Cancellation& cancellation);

  // With cells of this edge.
  double for_edge(double edge) const { return triangles_ + (widths_ + areas_ / edge) / edge; }
  // The smallest edge with at most this many; `most` is above the number of triangles.
  double edge_for(double most) const {
    const double half = widths_ / 2, rest = most - triangles_;
    return (half + std::sqrt(half * half + rest * areas_)) / rest;
  }

 private:
  double triangles_;
  double widths_ = 0;  // sum of the triangles' extents along x, y and z, in mm
  double areas_ = 0;   // sum of their projections along x, y and z, in mm^2
};

// A triangle against boxes of cells enlarged by a margin, by the separating axis theorem: both are
// apart along an axis of the box, the normal of the triangle, or the cross product of one of its
// edges with an axis of the box, or they meet. (Akenine-Moeller, "Fast 3D triangle-box overlap
// testing", 2001.)
class TriangleAmongCells {
 public:
  TriangleAmongCells(const CubicCells& cells, const Mesh& mesh,
                     const std::array<uint32_t, 3>& triangle, double margin)
      : cells_(cells), margin_(margin) {
    std::array<Vec3d, 3> corners;
    for (size_t k = 0; k < 3; ++k) {
      corners[k] = static_cast<Vec3d>(mesh.vertices[triangle[k]]) - cells.low;
    }
    const auto [a, b, c] = corners;
    range(a.x, b.x, c.x, 0);
    range(a.y, b.y, c.y, 1);
    range(a.z, b.z, c.z, 2);
    if (in_one_cell()) return;
    normal_ = cross(b - a, c - a);
    offset_ = dot(normal_, a);
    for (size_t k = 0; k < 3; ++k) {
      // Along the cross product of edge e and the axes, a point p lies at the components of p x e.
      const Vec3d edge = corners[(k + 1) % 3] - corners[k];
      const Vec3d here = cross(corners[k], edge), beyond = cross(corners[(k + 2) % 3], edge);
      sides_[k] = {
          edge,
          {std::min(here.x, beyond.x), std::min(here.y, beyond.y), std::min(here.z, beyond.z)},
          {std::max(here.x, beyond.x), std::max(here.y, beyond.y), std::max(here.z, beyond.z)}};
    }
  }

  // Calls visit(index) for each cell that the triangle touches.
  template <typename Visit>
  void for_each(const Visit& visit) const {
    if (in_one_cell()) {
      visit(cells_.index(first_[0], first_[1], first_[2]));
    } else {
      for_each_in({first_, last_}, visit);
    }
  }

 private:
  struct Box {
    std::array<int, 3> first, last;  // cells, both within
    int along(size_t axis) const { return last[axis] - first[axis] + 1; }
  };
  struct Side {
    Vec3d edge, low, high;
  };

  // The cells of the triangle's own box.
  void range(double a, double b, double c, size_t axis) {
    const auto cell = [&](double x) {
      // In this order NaN becomes 0.
      return static_cast<int>(
          std::min(std::max(0.0, x / cells_.edge), static_cast<double>(cells_.size[axis] - 1)));
    };
    first_[axis] = cell(std::min({a, b, c}) - margin_);
    last_[axis] = cell(std::max({a, b, c}) + margin_);
  }
  bool in_one_cell() const { return first_ == last_; }

  // Looks at boxes of cells before cells, so that it takes no longer than there are cells touched,
  // however little of its own box the triangle fills.
  template <typename Visit>
  void for_each_in(const Box& box, const Visit& visit) const {
    constexpr int kFewCells = 32;
    if (int64_t{box.along(0)} * box.along(1) * box.along(2) <= kFewCells) {
      for (int z = box.first[2]; z <= box.last[2]; ++z) {
        for (int y = box.first[1]; y <= box.last[1]; ++y) {
          for (int x = box.first[0]; x <= box.last[0]; ++x) {
            if (touches({{x, y, z}, {x, y, z}})) visit(cells_.index(x, y, z));
          }
        }
      }
    } else if (touches(box)) {
      size_t longest = box.along(1) > box.along(0) ? 1 : 0;
      longest = box.along(2) > box.along(longest) ? 2 : longest;
      Box lower = box, upper = box;
      lower.last[longest] = box.first[longest] + box.along(longest) / 2 - 1;
      upper.first[longest] = lower.last[longest] + 1;
      for_each_in(lower, visit);
      for_each_in(upper, visit);
    }
  }

  // Whether the triangle touches a box that meets its own.
  bool touches(const Box& box) const {
    const auto middle = [&](size_t axis) {
      return 0.5 * cells_.edge * (box.first[axis] + box.last[axis] + 1);
    };
    const auto half = [&](size_t axis) { return 0.5 * cells_.edge * box.along(axis) + margin_; };
    const Vec3d m{middle(0), middle(1), middle(2)}, h{half(0), half(1), half(2)};
    if (!(std::abs(dot(normal_, m) - offset_) <=
          h.x * std::abs(normal_.x) + h.y * std::abs(normal_.y) + h.z * std::abs(normal_.z))) {
      return false;
    }
    for (const auto& [edge, low, high] : sides_) {
      const Vec3d e{std::abs(edge.x), std::abs(edge.y), std::abs(edge.z)};
      const Vec3d at = cross(m, edge);
      const Vec3d reach{h.y * e.z + h.z * e.y, h.z * e.x + h.x * e.z, h.x * e.y + h.y * e.x};
      const bool meet = (at.x + reach.x >= low.x) & (at.x - reach.x <= high.x) &
                        (at.y + reach.y >= low.y) & (at.y - reach.y <= high.y) &
                        (at.z + reach.z >= low.z) & (at.z - reach.z <= high.z);
      if (!meet) return false;
    }
    return true;
  }

  const CubicCells& cells_;
  double margin_;
  std::array<int, 3> first_{}, last_{};
  Vec3d normal_;
  double offset_ = 0;
  std::array<Side, 3> sides_;
};

}  // namespace itn::tracer
