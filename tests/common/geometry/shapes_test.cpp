#include "common/geometry/shapes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>
#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Shapes, AreManyAndOfDifferentNames) {
  std::set<std::string_view> names;
  for (const ShapeInfo& info : builtin_shapes()) {
    names.insert(info.name);
    EXPECT_FALSE(info.description.empty());
  }
  EXPECT_EQ(names.size(), builtin_shapes().size());
  EXPECT_GE(names.size(), 12U);
}

class ShapeTest : public ::testing::TestWithParam<ShapeInfo> {
 protected:
  const Mesh mesh = make_shape(GetParam().name);
};

TEST_P(ShapeTest, IsClosedAndOutwardOriented) {
  validate_closed(mesh, std::string(GetParam().name));
  EXPECT_GT(signed_volume(mesh), 0.005);
  // No vertex twice, no triangle without three.
  const Mesh again = welded(mesh);
  EXPECT_EQ(again.vertices.size(), mesh.vertices.size());
  EXPECT_EQ(again.triangles.size(), mesh.triangles.size());
}

TEST_P(ShapeTest, StandsOnTheGroundWithLongestSideOne) {
  const Bounds box = bounds(mesh);
  const Vec3f extent = box.max - box.min;
  EXPECT_NEAR(std::max({extent.x, extent.y, extent.z}), 1, 1e-6);
  EXPECT_NEAR(box.min.y, 0, 1e-6);
  EXPECT_NEAR(box.min.x + box.max.x, 0, 1e-6);
  EXPECT_NEAR(box.min.z + box.max.z, 0, 1e-6);
}

TEST_P(ShapeTest, IsTheSameEveryTime) {
  const Mesh again = make_shape(GetParam().name);
  EXPECT_EQ(again.vertices, mesh.vertices);
  EXPECT_EQ(again.triangles, mesh.triangles);
}

// A surface that meets itself has points right behind it that it winds around twice, or points
// right in front of it that it winds around at all.
TEST_P(ShapeTest, DoesNotIntersectItself) {
  constexpr size_t kPoints = 40;
  const size_t stride = std::max<size_t>(1, mesh.triangles.size() / kPoints);
  for (size_t i = 0; i < mesh.triangles.size(); i += stride) {
    const auto& t = mesh.triangles[i];
    const Vec3d a(mesh.vertices[t[0]]), b(mesh.vertices[t[1]]), c(mesh.vertices[t[2]]);
    const Vec3d center = (a + b + c) * (1.0 / 3);
    const Vec3d normal = normalize(cross(b - a, c - a));
    EXPECT_NEAR(winding_number(mesh, center - normal * 1e-4), 1, 1e-3) << "triangle " << i;
    EXPECT_NEAR(winding_number(mesh, center + normal * 1e-4), 0, 1e-3) << "triangle " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(All, ShapeTest, ::testing::ValuesIn(builtin_shapes()),
                         [](const auto& row) { return std::string(row.param.name); });

// Inscribed in the smooth solid: a little smaller, by the square of the angle between facets.
TEST(Shapes, VolumesAgreeWithClosedForms) {
  const auto inscribed = [](const char* name, double exact, double missing) {
    const double volume = signed_volume(make_shape(name));
    EXPECT_LT(volume, exact * (1 + 1e-6)) << name;
    EXPECT_GT(volume, exact * (1 - missing)) << name;
  };
  EXPECT_NEAR(signed_volume(make_shape("cube")), 1, 1e-6);
  inscribed("sphere", kPi / 6, 0.001);
  inscribed("cylinder", kPi / 16, 0.0005);
  inscribed("cone", kPi * 0.16 / 3, 0.0005);
  // Radii 1 and 0.3, scaled to an outer diameter of 1.
  inscribed("torus", 2 * kPi * kPi * 0.09 / std::pow(2.6, 3), 0.004);
}

TEST(Shapes, ThatTakeASecondCanBeStopped) {
  std::stop_source stop;
  stop.request_stop();
  for (const char* name : {"frame", "mug", "figure", "tree"}) {
    testing::expect_error(ErrorKind::kCancelled, {"cancelled"},
                          [&] { make_shape(name, stop.get_token()); });
  }
}

TEST(Shapes, UnknownNameIsRefusedWithTheNamesThereAre) {
  for (const auto call : {+[] { make_shape("teapot"); }, +[] { check_shape_name("teapot"); }}) {
    testing::expect_error(ErrorKind::kInvalidInput,
                          {"no built-in shape \"teapot\"", "sphere, cube"}, call);
  }
}

}  // namespace
}  // namespace itn
