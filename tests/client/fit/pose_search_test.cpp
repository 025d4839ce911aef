// Masks of shapes that stand where they are known to.
#include "client/fit/pose_search.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "client/geometry/random_shape.h"
#include "common/error.h"
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
  return {{x, cross(z, x), z}, {20 * sign(), 20 * sign(), -480 + 60 * sign()}};
}

Mesh of_80_mm(const Mesh& shape) {
  Mesh mesh = normalized(shape);
  for (Vec3f& v : mesh.vertices) v = v * 80.0F;
  return mesh;
}

// Whether what the camera sees of the truth is seen in one of the poses that are found, as by half
// a degree and .5 % of the distance. A symmetric shape may be turned into itself.
bool is_found(const std::string& shape, const Mesh& mesh, uint64_t seed) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  SplitMix random(seed);
  const Pose truth = any_pose(random);
  const Silhouette true_view(mesh, truth, view);
  double nearest = HUGE_VAL;
  for (const FoundPose& one : find_poses(mesh, mask_of(mesh, truth, view), view)) {
    const double off = Silhouette(mesh, one.pose, view).depth_difference(true_view);
    std::printf("  %s: depths differ by %.2f mm, overlap %.4f, contours by %.2f pixels\n",
                shape.c_str(), off, one.overlap, one.distance);
    nearest = std::min(nearest, off);
  }
  return nearest < 0.5 * kDegree * 40 + 0.005 * 480;
}

TEST(PoseSearch, FindsWhereAnObjectStands) {
  EXPECT_TRUE(is_found("figure", of_80_mm(make_shape("figure")), 1));
  EXPECT_TRUE(is_found("mug", of_80_mm(make_shape("mug")), 2));
}

// The largest or the least of each pixel and its four neighbours.
std::vector<float> resized(const std::vector<float>& mask, int side, bool is_larger) {
  std::vector<float> result;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      float value = mask[static_cast<size_t>(y * side + x)];
      for (const auto& [u, v] : {std::pair{x - 1, y}, {x + 1, y}, {x, y - 1}, {x, y + 1}}) {
        if (std::min(u, v) < 0 || std::max(u, v) >= side) continue;
        const float other = mask[static_cast<size_t>(v * side + u)];
        value = is_larger ? std::max(value, other) : std::min(value, other);
      }
      result.push_back(value);
    }
  }
  return result;
}

// Masks of a thin object that are a pixel too large or too small all around must not bring it
// nearer or farther away.
TEST(PoseSearch, KnowsThatMasksMayBeTooLargeOrTooSmall) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  const double pixel = 480 / view.focal;  // mm
  for (const char* shape : {"figure", "knot"}) {
    const Mesh mesh = of_80_mm(make_shape(shape));
    SplitMix random(4);
    const Pose truth = any_pose(random);
    const std::vector<float> mask = mask_of(mesh, truth, view);
    for (const bool is_larger : {false, true}) {
      const auto poses = find_poses(mesh, resized(mask, view.side, is_larger), view);
      // A knot may be turned into itself.
      const Silhouette seen(mesh, truth, view);
      double nearest = HUGE_VAL;
      for (const FoundPose& one : poses) {
        nearest = std::min(nearest, Silhouette(mesh, one.pose, view).depth_difference(seen));
      }
      EXPECT_LT(nearest, 0.002 * 480) << shape << is_larger;
    }
  }
  // A ball may as well be larger by a pixel.
  const Mesh ball = of_80_mm(make_shape("sphere"));
  const Pose truth{.rotation = {}, .translation = {0, -40, -480}};
  const FoundPose found = matched(ball, mask_of(ball, truth, view), view, truth);
  EXPECT_NEAR(found.range_error, pixel / 40, 0.3 * pixel / 40);
}

// Pixels of a straight edge are off alike, so that parts of pixels count: the relief that the
// camera sees is told to a thousandth of the size.
TEST(PoseSearch, KnowsPartsOfPixels) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  for (const uint64_t seed : {1, 2, 3}) {
    for (const char* shape : {"cylinder", "cube"}) {
      Mesh mesh = of_80_mm(make_shape(shape));
      for (Vec3f& v : mesh.vertices) v.x *= 0.6F;
      SplitMix random(seed);
      const Pose truth = any_pose(random);
      const Pose near = moved(truth, middle_of(bounds(mesh)), {{0.03, 0.02, -0.02}, {2, -1, 6}});
      const FoundPose found = matched(mesh, mask_of(mesh, truth, view), view, near);
      const double off =
          Silhouette(mesh, found.pose, view).relief_difference(Silhouette(mesh, truth, view));
      std::printf("%s: %.3f mm\n", shape, off);
      EXPECT_LT(off, 0.08) << shape << " " << seed;
    }
  }
}

// Moved by .2 % of its size in waves, as what is printed or scanned is; but not as a whole, which a
// pose would take up.
Mesh uneven(Mesh mesh, SplitMix& random) {
  constexpr int kWaves = 60;
  constexpr double kSize = 80, kShortest = 0.25, kLongest = 1;
  struct Wave {
    Vec3d number, direction;
    double phase;
  };
  const auto sign = [&] { return 2 * random.uniform() - 1; };
  std::vector<Wave> waves;
  for (int i = 0; i < kWaves; ++i) {
    const double turns =
        2 * std::numbers::pi / (kSize * (kShortest + (kLongest - kShortest) * random.uniform()));
    waves.push_back({normalize(Vec3d{sign(), sign(), sign()}) * turns,
                     Vec3d{sign(), sign(), sign()}, 2 * std::numbers::pi * random.uniform()});
  }
  // A sign has the variance 1/3, a cosine 1/2.
  const double amplitude = 0.002 * kSize * std::sqrt(6.0 / kWaves);
  const auto count = static_cast<Eigen::Index>(mesh.vertices.size());
  Eigen::VectorXd by(3 * count);
  Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(3 * count, 6);
  for (Eigen::Index v = 0; v < count; ++v) {
    const auto place = static_cast<Vec3d>(mesh.vertices[static_cast<size_t>(v)]);
    Vec3d sum;
    for (const auto& [number, direction, phase] : waves) {
      sum = sum + direction * (amplitude * std::cos(dot(number, place) + phase));
    }
    by.segment<3>(3 * v) = Eigen::Vector3d(sum.x, sum.y, sum.z);
    whole.block<3, 3>(3 * v, 0).setIdentity();
    whole.block<3, 3>(3 * v, 3) << 0, place.z, -place.y, -place.z, 0, place.x, place.y, -place.x, 0;
  }
  by -= whole * (whole.transpose() * whole).ldlt().solve(whole.transpose() * by);
  for (Eigen::Index v = 0; v < count; ++v) {
    Vec3f& vertex = mesh.vertices[static_cast<size_t>(v)];
    vertex = static_cast<Vec3f>(static_cast<Vec3d>(vertex) +
                                Vec3d{by[3 * v], by[3 * v + 1], by[3 * v + 2]});
  }
  return mesh;
}

// Contours that are off by the shape are so over long parts, and errors say so: of the angle, whose
// error is that about the worst of three axes, and of the distance.
TEST(PoseSearch, KnowsThatTheShapeMayBeOff) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  double angles = 0, ranges = 0;
  int all = 0;
  for (const char* shape : {"mug", "figure", "twist"}) {
    const Mesh mesh = of_80_mm(make_shape(shape));
    for (const uint64_t seed : {1, 2, 3, 4, 5, 6}) {
      SplitMix random(seed);
      const Pose truth = any_pose(random);
      const Pose near = moved(truth, middle_of(bounds(mesh)), {{0.01, 0.01, -0.01}, {1, -1, 3}});
      const FoundPose found = matched(mesh, mask_of(uneven(mesh, random), truth, view), view, near);
      const double angle = angle_between(found.pose.rotation, truth.rotation) / kDegree;
      const Vec3d middle = middle_of(bounds(mesh));
      const double range = length(found.pose.to_scene(middle)) / length(truth.to_scene(middle)) - 1;
      angles += std::pow(angle / found.angle_error, 2);
      ranges += std::pow(range / found.range_error, 2);
      ++all;
    }
  }
  EXPECT_LT(angles, 2.0 * all);
  EXPECT_LT(ranges, 1.6 * all);
}

// A ball looks the same however it is turned, and its distance is known within an error: that is
// one pose.
TEST(PoseSearch, FindsABallOnce) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  const Mesh ball = of_80_mm(make_shape("sphere"));
  SplitMix random(3);
  const std::vector<float> mask = mask_of(ball, any_pose(random), view);
  EXPECT_EQ(find_poses(ball, resized(mask, view.side, false), view).size(), 1U);
}

// Shapes that nobody made, too: 19 of 20 at least.
TEST(PoseSearch, FindsWhereManyObjectsStand) {
  int found = 0, all = 0;
  for (uint64_t seed = 10; seed < 20; ++seed) {
    for (const char* shape : {"sphere", "figure", "mug", "knot"}) {
      found += is_found(shape, of_80_mm(make_shape(shape)), seed) ? 1 : 0;
      ++all;
    }
    for (const uint64_t set : {5U, 6U}) {
      const Mesh mesh = of_80_mm(random_shape(random_shape_seed(set, seed)));
      found += is_found("random", mesh, seed) ? 1 : 0;
      ++all;
    }
  }
  EXPECT_GE(found, 0.95 * all) << "of " << all;
}

// Whatever the search does, what it says of itself is so.
TEST(PoseSearch, SaysThatAShapeIsAnother) {
  const PinholeView view{.focal = 800, .center_x = 128, .center_y = 128, .side = 256};
  SplitMix random(3);
  const Pose truth = any_pose(random);
  const std::vector<float> mask = mask_of(of_80_mm(make_shape("figure")), truth, view);
  EXPECT_LT(find_poses(of_80_mm(make_shape("mug")), mask, view, {.views = 200, .moved = 8})
                .front()
                .overlap,
            0.9);
  EXPECT_THROW(find_poses(of_80_mm(make_shape("mug")), std::vector<float>(mask.size()), view),
               Error);
}

}  // namespace
}  // namespace itn
