#include "client/geometry/sdf/primitives.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "client/geometry/sdf/nodes.h"
#include "client/geometry/sdf/smooth.h"
#include "client/geometry/sdf/waves.h"

namespace itn::sdf {
namespace {

float hypotenuse(float a, float b) {
  return std::sqrt(a * a + b * b);
}

// The distance of what is behind both of two surfaces at right angles.
float corner(float a, float b) {
  return std::min(std::max(a, b), 0.0F) + hypotenuse(std::max(a, 0.0F), std::max(b, 0.0F));
}

// The largest of the distances from the planes.
class Polyhedron final : public Node {
 public:
  explicit Polyhedron(std::vector<Plane> planes) : planes_(std::move(planes)) {}
  void evaluate(const Points& points, Values& distances) const override {
    distances.fill(-std::numeric_limits<float>::infinity());
    for (const Plane& plane : planes_) {
      for (size_t i = 0; i < kLanes; ++i) {
        distances[i] = std::max(distances[i], dot(plane.normal, points[i]) - plane.offset);
      }
    }
  }

 private:
  std::vector<Plane> planes_;
};

class Limbs final : public Node {
 public:
  Limbs(const std::vector<Limb>& limbs, float fillet) : fillet_(fillet) {
    for (const Limb& limb : limbs) {
      const Vec3f axis = limb.to - limb.from;
      const float swelling = limb.to_radius - limb.from_radius;
      const float length2 = dot(axis, axis);
      // The slope of the distance is 1 across the axis, swelling / length along it.
      limbs_.push_back({limb.from, axis, axis * (1 / length2), limb.from_radius, swelling,
                        1 / std::sqrt(1 + swelling * swelling / length2)});
    }
  }
  void evaluate(const Points& points, Values& distances) const override {
    distances_to(limbs_[0], points, distances);
    Values others;
    for (size_t k = 1; k < limbs_.size(); ++k) {
      distances_to(limbs_[k], points, others);
      for (size_t i = 0; i < kLanes; ++i) {
        distances[i] = smooth_min(distances[i], others[i], fillet_);
      }
    }
  }

 private:
  struct Prepared {
    Vec3f from, axis, along;
    float radius, swelling, scale;
  };

  static void distances_to(const Prepared& limb, const Points& points, Values& distances) {
    for (size_t i = 0; i < kLanes; ++i) {
      const Vec3f p = points[i] - limb.from;
      const float t = std::min(std::max(dot(p, limb.along), 0.0F), 1.0F);
      const Vec3f off = p - limb.axis * t;
      distances[i] = (length(off) - (limb.radius + limb.swelling * t)) * limb.scale;
    }
  }

  std::vector<Prepared> limbs_;
  float fillet_;
};

// The distance from a polygon: that from the nearest edge, inside if a half line crosses edges an
// odd number of times.
class Polygon {
 public:
  explicit Polygon(const Outline& outline) {
    for (size_t i = 0; i < outline.size(); ++i) {
      const Vertex2 from = outline[i], to = outline[(i + 1) % outline.size()];
      const float x = to.x - from.x, y = to.y - from.y;
      edges_.push_back({from, {x, y}, 1 / (x * x + y * y), to.y, y == 0 ? 0 : x / y});
    }
  }

  void evaluate(const Values& x, const Values& y, Values& distances) const {
    Values squares, side;
    squares.fill(std::numeric_limits<float>::max());
    side.fill(1);
    for (const Edge& edge : edges_) {
      for (size_t i = 0; i < kLanes; ++i) {
        const float px = x[i] - edge.from.x, py = y[i] - edge.from.y;
        const float t = std::min(
            std::max((px * edge.along.x + py * edge.along.y) * edge.per_square, 0.0F), 1.0F);
        const float off_x = px - edge.along.x * t, off_y = py - edge.along.y * t;
        squares[i] = std::min(squares[i], off_x * off_x + off_y * off_y);
        const bool beside = (edge.from.y > y[i]) != (edge.to_y > y[i]);
        const bool crossed = px < edge.slope * py;
        side[i] = (beside & crossed) ? -side[i] : side[i];
      }
    }
    for (size_t i = 0; i < kLanes; ++i) distances[i] = side[i] * std::sqrt(squares[i]);
  }

 private:
  struct Edge {
    Vertex2 from, along;
    float per_square;  // of the length
    float to_y;
    float slope;  // dx / dy
  };
  std::vector<Edge> edges_;
};

class Extruded final : public Node {
 public:
  Extruded(const Outline& outline, float half_height)
      : polygon_(outline), half_height_(half_height) {}
  void evaluate(const Points& points, Values& distances) const override {
    polygon_.evaluate(points.x, points.z, distances);
    for (size_t i = 0; i < kLanes; ++i) {
      distances[i] = corner(distances[i], std::abs(points.y[i]) - half_height_);
    }
  }

 private:
  Polygon polygon_;
  float half_height_;
};

class Revolved final : public Node {
 public:
  explicit Revolved(const Outline& outline) : polygon_(outline) {}
  void evaluate(const Points& points, Values& distances) const override {
    Values radius;
    for (size_t i = 0; i < kLanes; ++i) radius[i] = hypotenuse(points.x[i], points.z[i]);
    polygon_.evaluate(radius, points.y, distances);
  }

 private:
  Polygon polygon_;
};

}  // namespace

Solid ball(float radius) {
  return primitive([=](Vec3f p) { return length(p) - radius; });
}

Solid box(Vec3f half) {
  return primitive([=](Vec3f p) {
    const Vec3f q{std::abs(p.x) - half.x, std::abs(p.y) - half.y, std::abs(p.z) - half.z};
    const Vec3f outside{std::max(q.x, 0.0F), std::max(q.y, 0.0F), std::max(q.z, 0.0F)};
    return length(outside) + std::min(std::max(std::max(q.x, q.y), q.z), 0.0F);
  });
}

Solid cylinder(float radius, float half_height) {
  return primitive(
      [=](Vec3f p) { return corner(hypotenuse(p.x, p.z) - radius, std::abs(p.y) - half_height); });
}

Solid torus(float radius, float tube_radius) {
  return primitive(
      [=](Vec3f p) { return hypotenuse(hypotenuse(p.x, p.z) - radius, p.y) - tube_radius; });
}

Solid cone(float bottom_radius, float top_radius, float half_height) {
  // The side's outward normal in the plane of the axis.
  const float widening = (bottom_radius - top_radius) / (2 * half_height);
  const float across = 1 / std::sqrt(1 + widening * widening), up = widening * across;
  const float middle_radius = (bottom_radius + top_radius) / 2;
  return primitive([=](Vec3f p) {
    const float side = (hypotenuse(p.x, p.z) - middle_radius) * across + p.y * up;
    return std::max(side, std::abs(p.y) - half_height);
  });
}

Solid polyhedron(std::vector<Plane> planes) {
  return Solid(std::make_shared<Polyhedron>(std::move(planes)));
}

Solid limbs(const std::vector<Limb>& limbs, float fillet) {
  return Solid(std::make_shared<Limbs>(limbs, fillet));
}

Solid extruded(const Outline& outline, float half_height) {
  return Solid(std::make_shared<Extruded>(outline, half_height));
}

Solid revolved(const Outline& outline) {
  return Solid(std::make_shared<Revolved>(outline));
}

Solid gyroid(float period, float thickness) {
  const auto k = static_cast<float>(2 * std::numbers::pi / period);
  constexpr float kQuarter = static_cast<float>(std::numbers::pi / 2);
  // |gradient| of sin x cos y + sin y cos z + sin z cos x is at most sqrt(3), and about that at the
  // surface.
  const float scale = 1 / (k * std::sqrt(3.0F));
  return primitive([=](Vec3f p) {
    const Vec3f q = p * k;
    const float value = fast_sin(q.x) * fast_sin(q.y + kQuarter) +
                        fast_sin(q.y) * fast_sin(q.z + kQuarter) +
                        fast_sin(q.z) * fast_sin(q.x + kQuarter);
    return std::abs(value) * scale - thickness / 2;
  });
}

}  // namespace itn::sdf
