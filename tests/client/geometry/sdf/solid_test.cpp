// Whether distances are bounds, and what makes solids of solids keeps them so.
#include "client/geometry/sdf/solid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "client/geometry/sdf/dice.h"
#include "client/geometry/sdf/operators.h"
#include "client/geometry/sdf/primitives.h"
#include "client/geometry/sdf/random_solid.h"

namespace itn::sdf {
namespace {

// The steepest slope found between points within reach, of pairs near and far.
float steepest(const Solid& solid, uint64_t seed) {
  SplitMix random(seed);
  Dice dice(random);
  const auto within_reach = [&] {
    return dice.direction() * (kReach * std::cbrt(dice.between(0, 1)));
  };
  float slope = 0;
  for (int batch = 0; batch < 200; ++batch) {
    Points from, to;
    for (size_t i = 0; i < kLanes; ++i) {
      const Vec3f p = within_reach();
      Vec3f q = p + dice.direction() * dice.scale(0.003F, 0.5F);
      if (length(q) > kReach) q = q * (kReach / length(q));
      from.set(i, p);
      to.set(i, q);
    }
    Values a, b;
    solid.evaluate(from, a);
    solid.evaluate(to, b);
    for (size_t i = 0; i < kLanes; ++i) {
      const float apart = length(from[i] - to[i]);
      // Rounding of distances is about 1e-6.
      if (apart > 1e-3F) slope = std::max(slope, (std::abs(a[i] - b[i]) - 2e-6F) / apart);
    }
  }
  return slope;
}

Waves waves(int octaves) {
  SplitMix random(4);
  return random_waves(random, 0.5F, 0.05F, octaves);
}

Solid some() {
  return united(box({0.3F, 0.6F, 0.2F}), moved(ball(0.4F), {0.4F, 0.1F, 0.2F}));
}

struct SolidRow {
  const char* name;
  Solid solid;
  float least;  // slope that must be seen somewhere: a bound far too low would be of no use
};

std::vector<SolidRow> solids() {
  return {
      {"ball", ball(0.8F), 0.99F},
      {"box", box({0.5F, 0.3F, 0.7F}), 0.99F},
      {"cylinder", cylinder(0.5F, 0.3F), 0.99F},
      {"torus", torus(0.7F, 0.2F), 0.99F},
      {"cone", cone(0.8F, 0, 0.5F), 0.99F},
      {"polyhedron", polyhedron({{normalize(Vec3f{1, 2, 3}), 0.3F}, {{-1, 0, 0}, 0.4F}}), 0.99F},
      {"limbs",
       limbs({{{0, -0.5F, 0}, {0, 0.5F, 0}, 0.4F, 0.1F}, {{0, 0, 0}, {0.3F, 0, 0.2F}, 0.3F, 0.5F}},
             0.1F),
       0.8F},
      {"star", extruded({{0, 1}, {-0.2F, 0.2F}, {-1, 0}, {-0.2F, -0.2F}, {0, -1}, {1, 0}}, 0.3F),
       0.99F},
      {"revolved", revolved({{0.3F, -0.5F}, {0.8F, 0}, {0.3F, 0.5F}}), 0.99F},
      {"gyroid", gyroid(1, 0.1F), 0.7F},
      {"united", united(some(), ball(0.5F), 0.2F), 0.99F},
      {"intersected", intersected(some(), ball(0.5F), 0.2F), 0.99F},
      {"subtracted", subtracted(some(), ball(0.5F), 0.2F), 0.99F},
      {"grown", grown(some(), 0.1F), 0.99F},
      {"hollowed", hollowed(some(), 0.1F), 0.99F},
      {"displaced", displaced(some(), waves(2)), 0.3F},
      {"creased", creased(some(), waves(2)), 0.3F},
      {"moved", moved(some(), {0.1F, 0.2F, 0.3F}), 0.99F},
      {"turned", turned(some(), Dice::rotation_from_y(normalize(Vec3f{1, 2, 3}))), 0.99F},
      {"scaled", scaled(some(), 0.4F), 0.99F},
      {"stretched", stretched(some(), {0.5F, 1.5F, 1}), 0.99F},
      {"elongated", elongated(some(), {0.2F, 0, 0.3F}), 0.99F},
      {"mirrored", mirrored(moved(some(), {0.4F, 0, 0})), 0.99F},
      {"repeated_around", repeated_around(moved(some(), {0.6F, 0, 0}), 5), 0.99F},
      {"repeated_along", repeated_along(box({0.1F, 0.4F, 0.2F}), 0.4F, 2), 0.99F},
      {"twisted", twisted(some(), 1.5F), 0.4F},
      {"bent", bent(some(), -1.2F), 0.4F},
      {"tapered", tapered(some(), 0.4F), 0.3F},
      {"wobbling", wobbling(some(), waves(1), waves(1), waves(1)), 0.2F},
  };
}

class SolidTest : public ::testing::TestWithParam<SolidRow> {};

TEST_P(SolidTest, IsABound) {
  const float slope = steepest(GetParam().solid, 1);
  EXPECT_LE(slope, 1.0005F);
  EXPECT_GE(slope, GetParam().least);
}

INSTANTIATE_TEST_SUITE_P(Table, SolidTest, ::testing::ValuesIn(solids()),
                         [](const auto& row) { return std::string(row.param.name); });

class KindTest : public ::testing::TestWithParam<KindInfo> {};

TEST_P(KindTest, IsABound) {
  for (uint64_t i = 0; i < 25; ++i) {
    SplitMix random(derive_seed(11, {i}));
    const float slope = steepest(random_solid(GetParam().kind, random), i);
    EXPECT_LE(slope, 1.001F) << "solid " << i;
    EXPECT_GE(slope, 0.05F) << "solid " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(All, KindTest, ::testing::ValuesIn(kKinds),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(Solid, OnePointIsAsGoodAsMany) {
  const Solid solid = some();
  Points points;
  for (size_t i = 0; i < kLanes; ++i) points.set(i, {0.01F * static_cast<float>(i), 0.2F, -0.3F});
  Values distances;
  solid.evaluate(points, distances);
  for (size_t i = 0; i < kLanes; ++i) EXPECT_EQ(solid.distance(points[i]), distances[i]);
}

TEST(Solid, DistancesOfPrimitivesAreExact) {
  EXPECT_FLOAT_EQ(ball(0.5F).distance({0, 2, 0}), 1.5F);
  EXPECT_FLOAT_EQ(box({1, 1, 1}).distance({4, 5, 1}), 5);
  EXPECT_FLOAT_EQ(box({1, 1, 1}).distance({0.75F, 0, 0}), -0.25F);
  EXPECT_FLOAT_EQ(cylinder(1, 1).distance({4, 5, 0}), 5);
  EXPECT_FLOAT_EQ(torus(1, 0.25F).distance({0, 0, 2}), 0.75F);
  EXPECT_FLOAT_EQ(extruded({{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}, 1).distance({4, 5, 1}), 5);
  EXPECT_FLOAT_EQ(revolved({{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}).distance({0, 5, 4}), 5);
  EXPECT_NEAR(limbs({{{0, 0, 0}, {1, 0, 0}, 0.25F, 0.25F}}, 0.1F).distance({0.5F, 1, 0}), 0.75F,
              1e-6F);
}

TEST(Solid, FilletsAddToUnionsAndTakeFromTheRest) {
  const Solid a = box({0.5F, 0.5F, 0.5F}), b = moved(ball(0.4F), {0.5F, 0, 0});
  const Vec3f seam{0.52F, 0.3F, 0.25F};
  EXPECT_LT(united(a, b, 0.2F).distance(seam), united(a, b).distance(seam));
  EXPECT_GT(intersected(a, b, 0.2F).distance(seam), intersected(a, b).distance(seam));
  EXPECT_GT(subtracted(a, b, 0.2F).distance(seam), subtracted(a, b).distance(seam));
}

TEST(FastSin, IsNearAndNoSteeper) {
  constexpr double kStep = 1e-3;
  for (double x = -30; x < 30; x += kStep) {
    const auto at = [](double y) { return double{fast_sin(static_cast<float>(y))}; };
    EXPECT_NEAR(at(x), std::sin(x), 0.0012);
    // Rounding of x, at 30, is 2e-6.
    EXPECT_LE(std::abs(at(x + kStep) - at(x)), kStep + 8e-6);
  }
}

TEST(RandomWaves, HaveTheRootMeanSquareThatIsAskedFor) {
  SplitMix random(3);
  const Waves sought = random_waves(random, 0.3F, 0.07F, 3);
  Dice dice(random);
  double squares = 0;
  constexpr int kPoints = 20000;
  for (int i = 0; i < kPoints; ++i) {
    const float value = sum(sought, dice.in_box({20, 20, 20}));
    squares += double{value} * value;
  }
  EXPECT_NEAR(std::sqrt(squares / kPoints), 0.07, 0.002);
}

}  // namespace
}  // namespace itn::sdf
