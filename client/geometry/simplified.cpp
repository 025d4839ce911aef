#include "client/geometry/simplified.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <tuple>
#include <vector>

namespace itn {
namespace {

// Without pairs of triangles that lie on each other, back to back, and enclose nothing.
std::vector<std::array<uint32_t, 3>> without_flaps(
    const std::vector<std::array<uint32_t, 3>>& triangles) {
  struct Corners {
    std::array<uint32_t, 3> sorted;
    bool turned;  // an odd permutation of them
    uint32_t triangle;
  };
  std::vector<Corners> all;
  for (uint32_t t = 0; t < triangles.size(); ++t) {
    const auto [a, b, c] = triangles[t];
    std::array<uint32_t, 3> sorted{a, b, c};
    std::ranges::sort(sorted);
    all.push_back({sorted, ((a > b) + (b > c) + (a > c)) % 2 == 1, t});
  }
  std::ranges::sort(all, {}, [](const Corners& c) { return std::tie(c.sorted, c.turned); });
  std::vector<bool> dropped(triangles.size(), false);
  for (size_t i = 0; i + 1 < all.size(); ++i) {
    if (all[i].sorted != all[i + 1].sorted || all[i].turned == all[i + 1].turned) continue;
    dropped[all[i].triangle] = dropped[all[i + 1].triangle] = true;
    ++i;
  }
  std::vector<std::array<uint32_t, 3>> kept;
  for (uint32_t t = 0; t < triangles.size(); ++t) {
    if (!dropped[t]) kept.push_back(triangles[t]);
  }
  return kept;
}

}  // namespace

Mesh simplified(const Mesh& mesh, size_t triangles) {
  constexpr float kAnyError = 1;
  std::vector<std::array<uint32_t, 3>> kept(mesh.triangles.size());
  const size_t indices = meshopt_simplify(
      kept.data()->data(), mesh.triangles.data()->data(), 3 * mesh.triangles.size(),
      &mesh.vertices.data()->x, mesh.vertices.size(), sizeof(Vec3f),
      3 * std::min(triangles, mesh.triangles.size()), kAnyError, 0, nullptr);
  kept.resize(indices / 3);
  return welded({mesh.vertices, without_flaps(kept)});
}

}  // namespace itn
