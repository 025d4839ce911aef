// Meshes that are hard on what is built over triangles: slivers, repetitions, extremes of size.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "common/geometry/mesh.h"
#include "common/geometry/shapes.h"

namespace itn::testing {

// Meshes side by side in one, their vertices not shared.
inline Mesh together(Mesh a, const Mesh& b) {
  const auto base = static_cast<uint32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles) a.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
  return a;
}

inline Mesh scaled(const Mesh& mesh, double s, Vec3d offset) {
  return transformed(mesh, {s, 0, 0, offset.x, 0, s, 0, offset.y, 0, 0, s, offset.z});
}

// A cone of 2 n triangles that meet in its tip and in the middle of its base.
inline Mesh cone_fan(uint32_t n) {
  Mesh mesh{{{0, 1, 0}, {0, 0, 0}}, {}};
  for (uint32_t i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    mesh.vertices.push_back(Vec3f(Vec3d{0.5 * std::cos(angle), 0, 0.5 * std::sin(angle)}));
    const uint32_t here = 2 + i, next = 2 + (i + 1) % n;
    mesh.triangles.push_back({0, next, here});
    mesh.triangles.push_back({1, here, next});
  }
  return mesh;
}

// Every triangle `times` times.
inline Mesh repeated(const Mesh& mesh, uint32_t times) {
  Mesh result{mesh.vertices, {}};
  for (uint32_t i = 0; i < times; ++i) {
    result.triangles.insert(result.triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
  }
  return result;
}

// n needles of 4 triangles, from point to point of a box of 1 mm.
inline Mesh needles(uint32_t n, double thickness = 1e-5) {
  Mesh mesh;
  uint64_t state = 1;
  const auto uniform = [&] {
    state = state * 6364136223846793005U + 1442695040888963407U;
    return static_cast<double>(state >> 11) * 0x1p-53;
  };
  for (uint32_t i = 0; i < n; ++i) {
    const Vec3d from{uniform(), uniform(), uniform()}, to{uniform(), uniform(), uniform()};
    const Basis<double> basis(normalize(to - from));
    const auto base = static_cast<uint32_t>(mesh.vertices.size());
    for (const Vec3d& v : {from + basis.s * thickness, from + basis.t * thickness,
                           from - (basis.s + basis.t) * thickness, to}) {
      mesh.vertices.push_back(static_cast<Vec3f>(v));
    }
    for (const auto& [a, b, c] :
         {std::array{0U, 2U, 1U}, {0U, 1U, 3U}, {1U, 2U, 3U}, {2U, 0U, 3U}}) {
      mesh.triangles.push_back({base + a, base + b, base + c});
    }
  }
  return mesh;
}

// n open slivers along the same diagonal of a box of 1 mm.
inline Mesh diagonal_slivers(uint32_t n) {
  Mesh mesh{{{0, 0, 0}, {1, 1, 1}, {0.5F, 0.5F, std::nextafter(0.5F, 1.0F)}}, {}};
  mesh.triangles.assign(n, {0, 1, 2});
  return mesh;
}

// A cube of 1 mm and one of 1e-9 mm.
inline Mesh large_and_tiny() {
  const Mesh cube = make_shape("cube");
  return together(cube, scaled(cube, 1e-9, {2, 0, 0}));
}

// n boxes of 1 mm x 1 mm, as thin as coordinates allow, above one another.
inline Mesh stacked_sheets(uint32_t n) {
  Mesh mesh;
  for (uint32_t i = 0; i < n; ++i) {
    mesh = together(std::move(mesh), transformed(make_shape("cube"), {1, 0, 0, 0, 0, 0.5 / n, 0,
                                                                      double(i) / n, 0, 0, 1, 0}));
  }
  return mesh;
}

}  // namespace itn::testing
