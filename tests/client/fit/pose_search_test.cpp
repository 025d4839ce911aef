// Masks of shapes that stand where they are known to.
#include "client/fit/pose_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "common/geometry/shapes.h"
#include "common/random.h"

namespace itn {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// The part of each pixel that is covered, by 4 x 4 places in it.
std::vector<float> mask_of(const Mesh& mesh, const Pose& pose, const PinholeView& view) {
  constexpr int kFine = 4;
  const Silhouette fine(mesh, pose, view.at_side(kFine * view.side));
  std::vector<float> mask;
  for (int y = 0; y < view.side; ++y) {
    for (int x = 0; x < view.side; ++x) {
      int covered = 0;
      for (int s = 0; s < kFine * kFine; ++s) {
        covered += fine.covers(kFine * x + s % kFine, kFine * y + s / kFine) ? 1 : 0;
      }
      mask.push_back(static_cast<float>(covered) / (kFine * kFine));
    }
  }
  return mask;
}

// Turned about any axis, some 450 mm in front of a camera whose axis it is beside.
Pose any_pose(SplitMix& random) {
  const auto sign = [&] { return 2 * random.uniform() - 1; };
  Vec3d z{sign(), sign(), sign()}, y{sign(), sign(), sign()};
  z = normalize(z);
  const Vec3d x = normalize(cross(y, z));
  return {{x, cross(z, x), z}, {40 * sign(), 40 * sign(), -450 + 60 * sign()}};
}

Mesh of_80_mm(const std::string& shape) {
  Mesh mesh = normalized(make_shape(shape));
  for (Vec3f& v : mesh.vertices) v = v * 80.0F;
  return mesh;
}

TEST(PoseSearch, FindsWhereAnObjectStands) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  SplitMix random(7);
  for (const char* shape : {"figure", "mug", "knot"}) {
    const Mesh mesh = of_80_mm(shape);
    for (int i = 0; i < 3; ++i) {
      const Pose truth = any_pose(random);
      const std::vector<FoundPose> found = find_poses(mesh, mask_of(mesh, truth, view), view);
      ASSERT_FALSE(found.empty());
      double angle = 180, range = 1;
      for (const FoundPose& one : found) {
        const double off = angle_between(one.pose.rotation, truth.rotation) / kDegree;
        std::printf(
            "  %s: %.2f degrees, range %+.4f, overlap %.4f, distance %.3f +- %.2f degrees %.4f\n",
            shape, off, length(one.pose.translation) / length(truth.translation) - 1, one.overlap,
            one.distance, one.angle_error, one.range_error);
        if (off > angle) continue;
        angle = off;
        range = length(one.pose.translation) / length(truth.translation) - 1;
      }
      EXPECT_LT(angle, 1) << shape;
      EXPECT_LT(std::abs(range), 0.005) << shape;
    }
  }
}

}  // namespace
}  // namespace itn
