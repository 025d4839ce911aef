#include "client/geometry/sdf/contouring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "client/geometry/sdf/dice.h"
#include "client/geometry/sdf/operators.h"
#include "client/geometry/sdf/primitives.h"
#include "client/geometry/sdf/random_solid.h"

namespace itn::sdf {
namespace {

constexpr double kPiD = std::numbers::pi;
constexpr size_t kTriangles = 20000;

// Every edge is passed as often one way as the other.
bool is_closed(const Mesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, int> passed;
  for (const auto& t : mesh.triangles) {
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t from = t[i], to = t[(i + 1) % 3];
      passed[std::minmax(from, to)] += from < to ? 1 : -1;
    }
  }
  return std::ranges::all_of(passed, [](const auto& edge) { return edge.second == 0; });
}

struct VolumeRow {
  const char* name;
  Solid solid;
  double volume;
  double tolerance;  // relative
};

std::vector<VolumeRow> volumes() {
  const Solid cube = box({0.5F, 0.5F, 0.5F});
  const Rotation<float> askew = Dice::rotation_from_y(normalize(Vec3f{1, 2, 3}));
  const double ball_volume = 4 * kPiD / 3 * 0.512;
  return {
      {"ball", ball(0.8F), ball_volume, 0.003},
      {"box", box({0.8F, 0.5F, 0.3F}), 0.96, 0.0005},
      {"box_askew", turned(box({0.8F, 0.5F, 0.3F}), askew), 0.96, 0.001},
      {"cylinder", cylinder(0.5F, 0.6F), kPiD * 0.25 * 1.2, 0.003},
      {"cone", cone(0.8F, 0, 0.6F), kPiD * 0.64 * 1.2 / 3, 0.003},
      {"torus", torus(0.7F, 0.25F), 2 * kPiD * kPiD * 0.7 * 0.0625, 0.004},
      {"limb", limbs({{{0, -0.5F, 0}, {0, 0.5F, 0}, 0.3F, 0.3F}}, 0.1F),
       kPiD * 0.09 * (1 + 4 * 0.3 / 3), 0.003},
      {"octahedron", polyhedron([] {
         std::vector<Plane> planes;
         for (int i = 0; i < 8; ++i) {
           const auto sign = [i](int bit) { return (i >> bit & 1) != 0 ? 1.0F : -1.0F; };
           planes.push_back({normalize(Vec3f{sign(0), sign(1), sign(2)}), 0.9F / std::sqrt(3.0F)});
         }
         return planes;
       }()),
       4.0 / 3 * 0.729, 0.002},
      // An L, either way round.
      {"extruded",
       extruded({{0, 0}, {0.8F, 0}, {0.8F, 0.3F}, {0.3F, 0.3F}, {0.3F, 0.8F}, {0, 0.8F}}, 0.4F),
       0.39 * 0.8, 0.001},
      {"extruded_clockwise",
       extruded({{0, 0.8F}, {0.3F, 0.8F}, {0.3F, 0.3F}, {0.8F, 0.3F}, {0.8F, 0}, {0, 0}}, 0.4F),
       0.39 * 0.8, 0.001},
      // A ring of rectangular section: Pappus.
      {"revolved", revolved({{0.5F, -0.2F}, {0.9F, -0.2F}, {0.9F, 0.2F}, {0.5F, 0.2F}}),
       2 * kPiD * 0.7 * 0.16, 0.003},
      {"united", united(cube, moved(cube, {0.25F, 0.25F, 0.25F})), 2 - 0.421875, 0.001},
      {"intersected", intersected(cube, moved(cube, {0.25F, 0.25F, 0.25F})), 0.421875, 0.001},
      {"drilled", subtracted(cube, cylinder(0.3F, 2)), 1 - kPiD * 0.09, 0.002},
      {"grown", grown(ball(0.5F), 0.3F), ball_volume, 0.003},
      {"hollowed", hollowed(ball(0.8F), 0.2F), ball_volume - 4 * kPiD / 3 * 0.216, 0.006},
      {"scaled", scaled(ball(1), 0.8F), ball_volume, 0.003},
      {"stretched", stretched(ball(1), {0.4F, 0.8F, 1.2F}), 4 * kPiD / 3 * 0.384, 0.004},
      {"elongated", elongated(ball(0.4F), {0.3F, 0.2F, 0}),
       4 * kPiD / 3 * 0.064 + kPiD * 0.16 * (0.6 + 0.4) + 0.6 * 0.4 * 0.8, 0.004},
      {"mirrored", mirrored(moved(cube, {0.6F, 0, 0})), 2, 0.002},
      {"repeated_around", repeated_around(moved(cylinder(0.2F, 0.3F), {0.8F, 0, 0}), 7),
       7 * kPiD * 0.04 * 0.6, 0.01},
      {"repeated_along", repeated_along(box({0.1F, 0.4F, 0.3F}), 0.4F, 2), 5 * 0.096, 0.003},
      // Volume is kept.
      {"twisted", twisted(box({0.3F, 0.8F, 0.3F}), 1.2F), 0.576, 0.003},
      // The integral of exp(-2 taper y).
      {"tapered", tapered(box({0.4F, 0.8F, 0.4F}), 0.4F), 0.64 * std::sinh(0.64) / 0.4, 0.003},
  };
}

class ContouredVolume : public ::testing::TestWithParam<VolumeRow> {};

TEST_P(ContouredVolume, IsThatOfTheSolid) {
  const Mesh mesh = contoured(GetParam().solid, kTriangles);
  EXPECT_TRUE(is_closed(mesh));
  EXPECT_NEAR(signed_volume(mesh) / GetParam().volume, 1, GetParam().tolerance);
  EXPECT_GT(mesh.triangles.size(), kTriangles / 2);
  EXPECT_LT(mesh.triangles.size(), kTriangles * 3 / 2);
}

INSTANTIATE_TEST_SUITE_P(Table, ContouredVolume, ::testing::ValuesIn(volumes()),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(Contoured, CornersStaySharp) {
  for (const bool askew : {false, true}) {
    const Rotation<float> pose =
        askew ? Dice::rotation_from_y(normalize(Vec3f{1, 2, 3})) : Rotation<float>{};
    const Mesh mesh = contoured(turned(box({0.8F, 0.6F, 0.5F}), pose), kTriangles);
    const float area = 4 * (0.8F * 0.6F + 0.6F * 0.5F + 0.5F * 0.8F) * 2;
    const float cell = std::sqrt(3 * area / static_cast<float>(mesh.triangles.size()));
    for (int c = 0; c < 8; ++c) {
      const Vec3f corner = pose(
          {(c & 1) != 0 ? 0.8F : -0.8F, (c & 2) != 0 ? 0.6F : -0.6F, (c & 4) != 0 ? 0.5F : -0.5F});
      float nearest = 1;
      for (const Vec3f p : mesh.vertices) nearest = std::min(nearest, length(p - corner));
      EXPECT_LT(nearest, 0.2F * cell) << "corner " << c;
    }
  }
}

// Whatever the solid: lattices at the edge of what the grid sees, sheets that nearly touch.
TEST(Contoured, IsClosedAndOutwardOriented) {
  for (const KindInfo& info : kKinds) {
    for (uint64_t i = 0; i < 8; ++i) {
      SplitMix random(derive_seed(21, {i}));
      const Mesh mesh = contoured(random_solid(info.kind, random), 3000);
      EXPECT_TRUE(is_closed(mesh)) << info.name << ' ' << i;
      EXPECT_GT(signed_volume(mesh), 0) << info.name << ' ' << i;
    }
  }
  for (const float period : {0.1F, 0.17F, 0.3F}) {
    const Mesh mesh = contoured(intersected(ball(1), gyroid(period, period / 4)), 6000);
    EXPECT_FALSE(mesh.triangles.empty());
    EXPECT_TRUE(is_closed(mesh)) << period;
  }
}

TEST(Contoured, IsCutOffAtReachAndEmptyBeyond) {
  const Mesh half = contoured(polyhedron({{{0, 1, 0}, 0.1F}}), kTriangles);
  EXPECT_FALSE(half.triangles.empty());
  EXPECT_TRUE(is_closed(half));
  EXPECT_TRUE(contoured(ball(3 * kReach), kTriangles).triangles.empty());
  EXPECT_TRUE(contoured(moved(ball(1), {9, 0, 0}), kTriangles).triangles.empty());
}

TEST(Contoured, IsTheSameEveryTime) {
  SplitMix a(5), b(5);
  const Mesh first = contoured(random_solid(Kind::kMachined, a), kTriangles);
  const Mesh again = contoured(random_solid(Kind::kMachined, b), kTriangles);
  EXPECT_EQ(first.vertices, again.vertices);
  EXPECT_EQ(first.triangles, again.triangles);
}

}  // namespace
}  // namespace itn::sdf
