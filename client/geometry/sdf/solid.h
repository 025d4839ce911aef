// Solids as functions of space: the signed distance to the surface, negative inside.
//
// Such a function may be a bound: it is 1-Lipschitz, so that no surface is nearer than its absolute
// value. Whatever makes solids of solids keeps that, by scaling down what it stretches.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <utility>

#include "common/vec.h"

namespace itn::sdf {

// The bound holds within this distance of the origin, and solids are made to fit into it.
inline constexpr float kReach = 1.5F;

// Solids are evaluated at so many points at a time, in loops that compilers vectorise.
inline constexpr size_t kLanes = 64;
using Values = std::array<float, kLanes>;
struct Points {
  Values x, y, z;

  Vec3f operator[](size_t i) const { return {x[i], y[i], z[i]}; }
  void set(size_t i, Vec3f p) { x[i] = p.x, y[i] = p.y, z[i] = p.z; }
};

// A node of the tree that a solid is.
class Node {
 public:
  virtual ~Node() = default;
  virtual void evaluate(const Points& points, Values& distances) const = 0;
};

// A value: copies share their nodes, which never change.
class Solid {
 public:
  explicit Solid(std::shared_ptr<const Node> node) : node_(std::move(node)) {}

  void evaluate(const Points& points, Values& distances) const {
    node_->evaluate(points, distances);
  }
  // At one point; as slow as at kLanes of them.
  float distance(Vec3f p) const;

 private:
  std::shared_ptr<const Node> node_;
};

}  // namespace itn::sdf
