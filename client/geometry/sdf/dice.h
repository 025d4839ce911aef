// The random choices that shapes are made by.
#pragma once

#include <cmath>
#include <initializer_list>
#include <numbers>

#include "common/random.h"
#include "common/vec.h"

namespace itn::sdf {

inline constexpr float kPi = std::numbers::pi_v<float>;

class Dice {
 public:
  explicit Dice(SplitMix& random) : random_(random) {}

  SplitMix& random() { return random_; }
  float between(float low, float high) {
    return low + (high - low) * static_cast<float>(random_.uniform());
  }
  // Uniform in the logarithm.
  float scale(float low, float high) { return low * std::pow(high / low, between(0, 1)); }
  int count(int low, int high) {
    return low + static_cast<int>(random_.below(uint64_t{1} + static_cast<unsigned>(high - low)));
  }
  bool chance(double probability) { return random_.uniform() < probability; }
  template <typename T>
  T one_of(std::initializer_list<T> values) {
    return values.begin()[random_.below(values.size())];
  }

  Vec3f in_box(Vec3f half) {
    const float x = between(-half.x, half.x), y = between(-half.y, half.y);
    return {x, y, between(-half.z, half.z)};
  }
  // On the unit sphere.
  Vec3f direction() {
    const float y = between(-1, 1), angle = between(0, 2 * kPi);
    const float across = std::sqrt(1 - y * y);
    return {across * std::cos(angle), y, across * std::sin(angle)};
  }
  // Uniform over all rotations (Shoemake, "Uniform Random Rotations", Graphics Gems III, 1992).
  Rotation<float> rotation() {
    const float u = between(0, 1), a = between(0, 2 * kPi), b = between(0, 2 * kPi);
    const float x = std::sqrt(1 - u) * std::sin(a), y = std::sqrt(1 - u) * std::cos(a);
    const float z = std::sqrt(u) * std::sin(b), w = std::sqrt(u) * std::cos(b);
    return {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
            {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
            {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  }
  // About the y axis.
  Rotation<float> heading() { return about_y(between(0, 2 * kPi)); }
  // The rotation of the y axis to one of the three axes.
  Rotation<float> axis() {
    switch (count(0, 2)) {
      case 0: return {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}};
      case 1: return {};
      default: return {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};
    }
  }

  static Rotation<float> about_y(float angle) {
    const float c = std::cos(angle), s = std::sin(angle);
    return {{c, 0, s}, {0, 1, 0}, {-s, 0, c}};
  }
  static Rotation<float> about_z(float angle) {
    const float c = std::cos(angle), s = std::sin(angle);
    return {{c, -s, 0}, {s, c, 0}, {0, 0, 1}};
  }
  // That takes the y axis to a unit vector.
  static Rotation<float> rotation_from_y(Vec3f to) {
    const Basis<float> basis(to);
    // Columns t, n, s: right-handed.
    return Rotation<float>{basis.t, basis.n, basis.s}.inverse();
  }

 private:
  SplitMix& random_;
};

}  // namespace itn::sdf
