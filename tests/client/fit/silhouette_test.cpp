#include "client/fit/silhouette.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "common/geometry/shapes.h"

namespace itn {
namespace {

// A cube of side 1 about the origin, larger by a factor, and moved.
void add_cube(Mesh& mesh, float side, Vec3f by) {
  const Mesh cube = normalized(make_shape("cube"));
  const Vec3f middle{0, 0.5F, 0};  // of the built-in cube, which stands on the ground
  const auto first = static_cast<uint32_t>(mesh.vertices.size());
  for (const Vec3f v : cube.vertices) mesh.vertices.push_back((v - middle) * side + by);
  for (const auto& [a, b, c] : cube.triangles) {
    mesh.triangles.push_back({a + first, b + first, c + first});
  }
}

// A small cube in front of a large one: squares of 4 x 4 pixels show one surface in the middle of
// either, and two, or none, at the contours of both.
TEST(Silhouette, KnowsWhatShowsOneSurface) {
  Mesh mesh;
  add_cube(mesh, 40, {0, 0, 0});
  add_cube(mesh, 10, {0, 0, 30});
  const Pose pose{.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, .translation = {0, 0, -400}};
  constexpr int kViewSide = 256;
  const PinholeView view{.focal = 1600, .center_x = 128, .center_y = 128, .side = kViewSide};
  const Silhouette silhouette(mesh, pose, view);
  // In pixels from the middle: half of the small cube's front, and half of the large one's.
  constexpr double kSmall = 1600 * 5 / 365.0, kLarge = 1600 * 20 / 380.0;
  int shown = 0;
  for (int left = 0; left < kViewSide; left += 4) {
    const double away = std::abs(left + 2 - kViewSide / 2);  // of its middle
    const bool crosses = std::abs(away - kSmall) < 2 || away > kLarge - 2;
    const bool is_clear = std::abs(away - kSmall) > 4 && away < kLarge - 4;
    const bool shows = silhouette.shows_one_surface(left, kViewSide / 2, 4);
    EXPECT_FALSE(shows && crosses) << left;
    EXPECT_FALSE(!shows && is_clear) << left;
    const bool covers = silhouette.covers_square(left, kViewSide / 2, 4);
    EXPECT_FALSE(covers && away > kLarge - 2) << left;
    EXPECT_FALSE(!covers && away < kLarge - 4) << left;
    shown += shows ? 1 : 0;
  }
  EXPECT_GT(shown, 30);
  EXPECT_LT(shown, 42);
}

}  // namespace
}  // namespace itn
