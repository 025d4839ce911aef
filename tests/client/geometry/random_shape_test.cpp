#include "client/geometry/random_shape.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "client/geometry/sdf/random_solid.h"

namespace itn {
namespace {

constexpr uint64_t kShapes = 300;

Mesh shape(uint64_t index) {
  return random_shape(random_shape_seed(5, index));
}

TEST(RandomShape, IsAWholeSolidForEverySeed) {
  std::set<double> volumes;
  for (uint64_t i = 0; i < kShapes; ++i) {
    SCOPED_TRACE(random_shape_name(5, i));
    const Mesh mesh = shape(i);
    validate_closed(mesh, "it");
    EXPECT_GE(mesh.triangles.size(), kMinRandomTriangles);
    EXPECT_LE(mesh.triangles.size(), kMaxRandomTriangles);
    // No vertex twice, no triangle without three.
    EXPECT_EQ(welded(mesh).vertices.size(), mesh.vertices.size());
    EXPECT_EQ(welded(mesh).triangles.size(), mesh.triangles.size());
    const Bounds box = bounds(mesh);
    const Vec3f extent = box.max - box.min;
    EXPECT_NEAR(std::max({extent.x, extent.y, extent.z}), 1, 1e-6);
    EXPECT_GE(std::min({extent.x, extent.y, extent.z}), 0.05);
    EXPECT_NEAR(box.min.y, 0, 1e-6);
    EXPECT_NEAR(box.min.x + box.max.x, 0, 1e-6);
    EXPECT_NEAR(box.min.z + box.max.z, 0, 1e-6);
    EXPECT_GT(signed_volume(mesh), 0.004);
    EXPECT_LE(signed_volume(mesh), double{extent.x} * extent.y * extent.z);
    volumes.insert(signed_volume(mesh));
  }
  EXPECT_EQ(volumes.size(), kShapes);
}

// The same of many shapes as of the built-in ones: points right behind the surface that it winds
// around twice, or right in front of it that it winds around at all, may be two in a thousand.
TEST(RandomShape, HardlyEverCutsThroughItself) {
  size_t points = 0, wrong = 0;
  for (uint64_t i = 0; i < 60; ++i) {
    const Mesh mesh = shape(i);
    for (size_t k = i; k < mesh.triangles.size(); k += 100) {
      const auto& t = mesh.triangles[k];
      const Vec3d a(mesh.vertices[t[0]]), b(mesh.vertices[t[1]]), c(mesh.vertices[t[2]]);
      const Vec3d center = (a + b + c) * (1.0 / 3);
      const Vec3d normal = normalize(cross(b - a, c - a));
      constexpr double kBeside = 1e-5;
      wrong += std::abs(winding_number(mesh, center - normal * kBeside) - 1) > 0.1;
      wrong += std::abs(winding_number(mesh, center + normal * kBeside)) > 0.1;
      points += 2;
    }
  }
  EXPECT_GT(points, 4000U);
  EXPECT_LE(wrong, points / 500);
}

TEST(RandomShape, IsAFunctionOfItsSeed) {
  for (uint64_t i = 0; i < 10; ++i) {
    const Mesh first = shape(i), again = shape(i), other = shape(i + 1);
    EXPECT_EQ(first.vertices, again.vertices);
    EXPECT_EQ(first.triangles, again.triangles);
    EXPECT_NE(first.vertices, other.vertices);
  }
}

TEST(RandomShape, NamesAndSeedsTellShapesApart) {
  EXPECT_EQ(random_shape_name(7, 12), "random-7-12");
  std::set<uint64_t> seeds;
  for (uint64_t set = 0; set < 20; ++set) {
    for (uint64_t i = 0; i < 20; ++i) seeds.insert(random_shape_seed(set, i));
  }
  EXPECT_EQ(seeds.size(), 400U);
}

TEST(RandomKind, ComesWithItsProbability) {
  double sum = 0;
  for (const sdf::KindInfo& info : sdf::kKinds) sum += info.probability;
  EXPECT_NEAR(sum, 1, 1e-9);
  constexpr int kDraws = 20000;
  std::map<sdf::Kind, int> count;
  SplitMix random(3);
  for (int i = 0; i < kDraws; ++i) ++count[sdf::random_kind(random)];
  for (const sdf::KindInfo& info : sdf::kKinds) {
    // Four standard deviations.
    const double sd = std::sqrt(info.probability * (1 - info.probability) * kDraws);
    EXPECT_NEAR(count[info.kind], info.probability * kDraws, 4 * sd) << info.name;
  }
}

}  // namespace
}  // namespace itn
