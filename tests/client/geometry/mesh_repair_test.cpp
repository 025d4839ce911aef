#include "client/geometry/mesh_repair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "common/geometry/shapes.h"
#include "tests/support/expect_error.h"
#include "tests/support/hard_meshes.h"

namespace itn {
namespace {

using namespace testing;

// Takes out the triangles around a vertex: a hole of as many edges.
size_t punch(Mesh& mesh, uint32_t vertex) {
  const size_t before = mesh.triangles.size();
  std::erase_if(mesh.triangles, [&](const auto& t) { return std::ranges::count(t, vertex) > 0; });
  return before - mesh.triangles.size();
}

TEST(MeshRepairTest, LeavesAClosedMeshAsItIs) {
  const Mesh star = make_shape("smooth_star");
  const MeshRepair repair = repaired(star, "star");
  EXPECT_FALSE(repair.changed());
  EXPECT_EQ(repair.describe(), "nothing to repair");
  EXPECT_EQ(repair.mesh.triangles, welded(star).triangles);
}

TEST(MeshRepairTest, FillsHoles) {
  const Mesh star = make_shape("smooth_star");
  Mesh mesh = star;
  std::vector<size_t> edges;
  for (const uint32_t vertex : {100U, 2000U, 7000U}) edges.push_back(punch(mesh, vertex));
  MeshRepair repair = repaired(mesh, "star");
  std::ranges::sort(edges);
  std::ranges::sort(repair.filled_hole_edges);
  EXPECT_EQ(repair.filled_hole_edges, edges);
  EXPECT_EQ(repair.turned_triangles, 0U);
  EXPECT_EQ(repair.welded_vertices, 0U);
  EXPECT_NEAR(signed_volume(repair.mesh), signed_volume(star), 1e-4);
  validate_closed(repair.mesh, "star");
}

// A cylinder without its top and bottom.
TEST(MeshRepairTest, FillsALargeFlatHole) {
  Mesh tube;
  constexpr uint32_t kSides = 200;
  for (uint32_t i = 0; i < kSides; ++i) {
    const double angle = 2 * std::numbers::pi * i / kSides;
    for (const double y : {0.0, 1.0}) {
      tube.vertices.push_back(Vec3f(Vec3d{std::cos(angle), y, std::sin(angle)}));
    }
    const uint32_t a = 2 * i, b = 2 * ((i + 1) % kSides);
    tube.triangles.push_back({a, a + 1, b});
    tube.triangles.push_back({b, a + 1, b + 1});
  }
  const MeshRepair repair = repaired(tube, "tube");
  EXPECT_EQ(repair.filled_hole_edges, (std::vector<size_t>{kSides, kSides}));
  EXPECT_NEAR(signed_volume(repair.mesh), std::numbers::pi, 2e-3);
}

TEST(MeshRepairTest, WeldsCracks) {
  // Every triangle by itself, its corners moved by rounding.
  const Mesh solid = make_shape("knot");
  Mesh soup;
  uint32_t state = 1;
  for (const auto& t : solid.triangles) {
    for (const uint32_t v : t) {
      state = state * 1664525U + 1013904223U;
      const float by = 1e-6F * static_cast<float>(state >> 24) / 256;
      soup.vertices.push_back(solid.vertices[v] + Vec3f{by, -by, by});
    }
    const auto base = static_cast<uint32_t>(soup.vertices.size() - 3);
    soup.triangles.push_back({base, base + 1, base + 2});
  }
  const MeshRepair repair = repaired(soup, "soup");
  EXPECT_EQ(repair.mesh.vertices.size(), solid.vertices.size());
  EXPECT_EQ(repair.mesh.triangles.size(), solid.triangles.size());
  EXPECT_GT(repair.welded_vertices, 4 * solid.vertices.size());
  EXPECT_NEAR(signed_volume(repair.mesh), signed_volume(solid), 1e-4);
}

TEST(MeshRepairTest, TurnsTriangles) {
  const Mesh solid = make_shape("mug");
  Mesh mesh = solid;
  size_t turned = 0;
  for (size_t i = 0; i < mesh.triangles.size(); i += 7, ++turned) {
    std::swap(mesh.triangles[i][0], mesh.triangles[i][1]);
  }
  EXPECT_EQ(repaired(mesh, "mug").turned_triangles, turned);
  // The first triangle that agreement begins at may be one of those: then all are turned twice.
  EXPECT_NEAR(signed_volume(repaired(mesh, "mug").mesh), signed_volume(solid), 1e-9);
  for (auto& t : mesh.triangles = solid.triangles) std::swap(t[0], t[1]);
  EXPECT_EQ(repaired(mesh, "mug").turned_triangles, mesh.triangles.size());
}

TEST(MeshRepairTest, KeepsCavitiesAndDropsRepeatedTriangles) {
  const Mesh sphere = make_shape("sphere");
  Mesh mesh = together(sphere, scaled(sphere, 0.5, {0, 0.25, 0}));  // as a solid: to be a cavity
  const size_t punched = punch(mesh, 50);
  mesh.triangles.push_back(mesh.triangles[17]);
  const MeshRepair repair = repaired(mesh, "shell");
  EXPECT_EQ(repair.turned_triangles, sphere.triangles.size());
  EXPECT_EQ(repair.dropped_triangles, 1U);
  EXPECT_EQ(repair.filled_hole_edges, std::vector<size_t>{punched});
  EXPECT_NEAR(signed_volume(repair.mesh), 0.875 * signed_volume(sphere), 1e-4);
  EXPECT_EQ(repair.describe(), "1 triangle dropped, 1 hole filled (of " + std::to_string(punched) +
                                   " edges), 20480 triangles turned");
}

// A corner on an edge of the facet beside it, with which it has a facet of no area.
TEST(MeshRepairTest, DropsFacetsOfNoArea) {
  Mesh mesh = make_shape("cube");
  const auto [a, b, c] = mesh.triangles[0];
  const auto middle = static_cast<uint32_t>(mesh.vertices.size());
  mesh.vertices.push_back((mesh.vertices[a] + mesh.vertices[b]) * 0.5F);
  mesh.triangles[0] = {a, middle, c};
  mesh.triangles.push_back({middle, b, c});
  mesh.triangles.push_back({b, middle, a});
  ASSERT_NO_THROW(validate_closed(mesh, "cube"));
  const MeshRepair repair = repaired(mesh, "cube");
  EXPECT_EQ(repair.describe(), "1 facet of no area dropped");
  EXPECT_EQ(repair.mesh.triangles.size(), 14U);
  EXPECT_DOUBLE_EQ(signed_volume(repair.mesh), 1);
  EXPECT_NO_THROW(validate_closed(repair.mesh, "cube"));
}

TEST(MeshRepairTest, SaysWhatCannotBeRepaired) {
  Mesh mesh = make_shape("sphere");
  const size_t edges = punch(mesh, 3);
  expect_error(ErrorKind::kInvalidInput,
               {"ball cannot be repaired", "holes of at most 3 edges", "ball is not closed",
                std::to_string(edges) + " open edges"},
               [&] { repaired(mesh, "ball", {.max_hole_edges = 3}); });
  // Three triangles at an edge bound nothing.
  Mesh fin = make_shape("cube");
  fin.vertices.push_back({3, 3, 3});
  fin.triangles.push_back({0, 1, 8});
  expect_error(ErrorKind::kInvalidInput, {"fin cannot be repaired"}, [&] { repaired(fin, "fin"); });
}

}  // namespace
}  // namespace itn
