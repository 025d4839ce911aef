// The kinds of nodes that solids are made of, each around a function of one point. Internal to the
// files that make solids.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "client/geometry/sdf/solid.h"

namespace itn::sdf {

// A primitive: distance(point).
template <typename Distance>
class Primitive final : public Node {
 public:
  explicit Primitive(Distance distance) : distance_(std::move(distance)) {}
  void evaluate(const Points& points, Values& distances) const override {
    for (size_t i = 0; i < kLanes; ++i) distances[i] = distance_(points[i]);
  }

 private:
  Distance distance_;
};

// Two solids: combine(distance, other distance).
template <typename Combine>
class Combined final : public Node {
 public:
  Combined(Solid a, Solid b, Combine combine)
      : a_(std::move(a)), b_(std::move(b)), combine_(std::move(combine)) {}
  void evaluate(const Points& points, Values& distances) const override {
    Values others;
    a_.evaluate(points, distances);
    b_.evaluate(points, others);
    for (size_t i = 0; i < kLanes; ++i) distances[i] = combine_(distances[i], others[i]);
  }

 private:
  Solid a_, b_;
  Combine combine_;
};

// A solid in other coordinates: its distance at map(point), times a scale.
template <typename Map>
class Warped final : public Node {
 public:
  Warped(Solid solid, Map map, float scale)
      : solid_(std::move(solid)), map_(std::move(map)), scale_(scale) {}
  void evaluate(const Points& points, Values& distances) const override {
    Points mapped;
    for (size_t i = 0; i < kLanes; ++i) mapped.set(i, map_(points[i]));
    solid_.evaluate(mapped, distances);
    for (float& d : distances) d *= scale_;
  }

 private:
  Solid solid_;
  Map map_;
  float scale_;
};

// A solid whose distances are changed: change(distance, point).
template <typename Change>
class Changed final : public Node {
 public:
  Changed(Solid solid, Change change) : solid_(std::move(solid)), change_(std::move(change)) {}
  void evaluate(const Points& points, Values& distances) const override {
    solid_.evaluate(points, distances);
    for (size_t i = 0; i < kLanes; ++i) distances[i] = change_(distances[i], points[i]);
  }

 private:
  Solid solid_;
  Change change_;
};

template <typename Distance>
Solid primitive(Distance distance) {
  return Solid(std::make_shared<Primitive<Distance>>(std::move(distance)));
}

template <typename Combine>
Solid combined(Solid a, Solid b, Combine combine) {
  return Solid(std::make_shared<Combined<Combine>>(std::move(a), std::move(b), std::move(combine)));
}

template <typename Map>
Solid warped(Solid solid, Map map, float scale = 1) {
  return Solid(std::make_shared<Warped<Map>>(std::move(solid), std::move(map), scale));
}

template <typename Change>
Solid changed(Solid solid, Change change) {
  return Solid(std::make_shared<Changed<Change>>(std::move(solid), std::move(change)));
}

}  // namespace itn::sdf
