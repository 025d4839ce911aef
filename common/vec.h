// Three-vectors. Plain data; float in the walk, double where positions are far apart.
#pragma once

#include <cmath>

namespace itn {

template <typename T>
struct Vec3 {
  T x = 0, y = 0, z = 0;

  Vec3 operator+(Vec3 b) const { return {x + b.x, y + b.y, z + b.z}; }
  Vec3 operator-(Vec3 b) const { return {x - b.x, y - b.y, z - b.z}; }
  Vec3 operator-() const { return {-x, -y, -z}; }
  Vec3 operator*(T s) const { return {x * s, y * s, z * s}; }
  bool operator==(const Vec3&) const = default;

  template <typename U>
  explicit operator Vec3<U>() const {
    return {static_cast<U>(x), static_cast<U>(y), static_cast<U>(z)};
  }
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

template <typename T>
T dot(Vec3<T> a, Vec3<T> b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <typename T>
Vec3<T> cross(Vec3<T> a, Vec3<T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <typename T>
T length(Vec3<T> a) {
  return std::sqrt(dot(a, a));
}

template <typename T>
Vec3<T> normalize(Vec3<T> a) {
  return a * (T(1) / length(a));
}

template <typename T>
bool is_finite(Vec3<T> a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}

// Turned about a unit axis, counter-clockwise seen against it (Rodrigues' formula).
inline Vec3<double> turned_about(Vec3<double> v, Vec3<double> axis, double radians) {
  const double c = std::cos(radians), s = std::sin(radians);
  return v * c + cross(axis, v) * s + axis * (dot(axis, v) * (1 - c));
}

// A rotation by its matrix: of orthonormal rows that make a right-handed basis.
template <typename T>
struct Rotation {
  Vec3<T> x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};  // rows

  bool operator==(const Rotation&) const = default;
  Vec3<T> operator()(Vec3<T> v) const { return {dot(x, v), dot(y, v), dot(z, v)}; }
  Rotation inverse() const { return {{x.x, y.x, z.x}, {x.y, y.y, z.y}, {x.z, y.z, z.z}}; }
  // First `before`, then this.
  Rotation after(const Rotation& before) const {
    const Rotation columns = before.inverse();
    return {columns(x), columns(y), columns(z)};
  }
  template <typename U>
  explicit operator Rotation<U>() const {
    return {static_cast<Vec3<U>>(x), static_cast<Vec3<U>>(y), static_cast<Vec3<U>>(z)};
  }
};

// Two unit vectors that complete the unit vector n to a right-handed orthonormal basis.
// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017.
template <typename T>
struct Basis {
  Vec3<T> s, t, n;

  explicit Basis(Vec3<T> normal) : n(normal) {
    const T sign = std::copysign(T(1), n.z);
    const T a = T(-1) / (sign + n.z);
    const T b = n.x * n.y * a;
    s = {T(1) + sign * n.x * n.x * a, sign * b, -sign * n.x};
    t = {b, sign + n.y * n.y * a, -n.y};
  }

  Vec3<T> to_world(T x, T y, T z) const { return s * x + t * y + n * z; }
};

}  // namespace itn
