#include "client/geometry/random_shape.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "client/geometry/sdf/contouring.h"
#include "client/geometry/sdf/dice.h"
#include "client/geometry/sdf/random_solid.h"
#include "client/geometry/simplified.h"
#include "common/error.h"
#include "common/geometry/mesh_parts.h"
#include "common/random.h"

namespace itn {
namespace {

// The surface is contoured with so many triangles first, for the sake of details, and simplified
// then to about kTriangles, which takes most where it is flat.
constexpr size_t kFineTriangles = 24000;
constexpr size_t kTriangles = 4000;

// A shape with less volume, or a shorter side, in the unit cube is rejected: it would hardly be
// seen.
constexpr double kMinVolume = 0.004, kMinExtent = 0.05;
// A cavity of a smaller part of the solid's volume is an accident, and filled.
constexpr double kMinCavity = 1e-3;
// A shape whose largest solid has less than this part of all triangles is in pieces, and rejected.
constexpr double kMinShare = 0.6;

double volume_of(const Mesh& mesh, const std::vector<uint32_t>& triangles) {
  double sum = 0;
  for (const uint32_t t : triangles) sum += volume6(mesh, mesh.triangles[t], {}) / 6;
  return sum;
}

// The triangles of each connected part.
std::vector<std::vector<uint32_t>> parts_of(const Mesh& mesh) {
  DisjointSets joined(mesh.vertices.size());
  for (const auto& t : mesh.triangles) {
    joined.join(t[0], t[1]);
    joined.join(t[1], t[2]);
  }
  std::vector<int32_t> part_of(mesh.vertices.size(), -1);
  std::vector<std::vector<uint32_t>> parts;
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    int32_t& part = part_of[joined.find(mesh.triangles[t][0])];
    if (part < 0) {
      part = static_cast<int32_t>(parts.size());
      parts.emplace_back();
    }
    parts[part].push_back(t);
  }
  return parts;
}

Mesh with_triangles(const Mesh& mesh, const std::vector<uint32_t>& triangles) {
  Mesh result{mesh.vertices, {}};
  for (const uint32_t t : triangles) result.triangles.push_back(mesh.triangles[t]);
  return result;
}

// The largest solid with its cavities; nothing if it is not most of the mesh.
std::optional<Mesh> largest_solid(const Mesh& mesh) {
  const auto parts = parts_of(mesh);
  std::vector<double> volumes;
  volumes.reserve(parts.size());
  for (const auto& part : parts) volumes.push_back(volume_of(mesh, part));
  const auto largest = static_cast<size_t>(std::ranges::max_element(volumes) - volumes.begin());
  if (parts.empty() || !(volumes[largest] > 0)) return {};
  const Mesh solid = with_triangles(mesh, parts[largest]);
  std::vector<uint32_t> kept = parts[largest];
  for (size_t i = 0; i < parts.size(); ++i) {
    if (-volumes[i] < kMinCavity * volumes[largest]) continue;
    const Vec3f at = mesh.vertices[mesh.triangles[parts[i][0]][0]];
    if (winding_number(solid, Vec3d(at)) > 0.5) {
      kept.insert(kept.end(), parts[i].begin(), parts[i].end());
    }
  }
  if (static_cast<double>(kept.size()) < kMinShare * static_cast<double>(mesh.triangles.size())) {
    return {};
  }
  return with_triangles(mesh, kept);
}

Mesh turned(const Mesh& mesh, const Rotation<float>& r) {
  return transformed(mesh,
                     {r.x.x, r.x.y, r.x.z, 0, r.y.x, r.y.y, r.y.z, 0, r.z.x, r.z.y, r.z.z, 0});
}

bool is_closed(const Mesh& mesh) {
  try {
    validate_closed(mesh, "");
    return true;
  } catch (const Error&) {
    return false;
  }
}

bool is_usable(const Mesh& mesh) {
  if (mesh.triangles.size() < kMinRandomTriangles || mesh.triangles.size() > kMaxRandomTriangles) {
    return false;
  }
  const Bounds box = bounds(mesh);
  const Vec3f extent = box.max - box.min;
  return std::min({extent.x, extent.y, extent.z}) >= kMinExtent &&
         signed_volume(mesh) >= kMinVolume && is_closed(mesh);
}

std::optional<Mesh> attempt(sdf::Kind kind, SplitMix random) {
  const sdf::Solid solid = sdf::random_solid(kind, random);
  const std::optional<Mesh> whole = largest_solid(sdf::contoured(solid, kFineTriangles));
  if (!whole || whole->triangles.size() < kMinRandomTriangles) return {};
  sdf::Dice dice(random);
  const Rotation<float> pose = dice.chance(0.5) ? dice.heading() : dice.rotation();
  Mesh mesh = normalized(turned(simplified(*whole, kTriangles), pose));
  if (!is_usable(mesh)) return {};
  return mesh;
}

}  // namespace

sdf::Kind random_shape_kind(uint64_t seed) {
  SplitMix random(seed);
  return sdf::random_kind(random);
}

Mesh random_shape(uint64_t seed) {
  const sdf::Kind kind = random_shape_kind(seed);
  // Nine of ten attempts succeed.
  for (uint64_t i = 0;; ++i) {
    if (std::optional<Mesh> mesh = attempt(kind, SplitMix(derive_seed(seed, {i})))) {
      return *std::move(mesh);
    }
  }
}

uint64_t random_shape_seed(uint64_t set_seed, uint64_t index) {
  return derive_seed(set_seed, {index});
}

std::string random_shape_name(uint64_t set_seed, uint64_t index) {
  return fmt::format("random-{}-{}", set_seed, index);
}

}  // namespace itn
