#include "server/tracer/wavefront/walk/paths.h"

#include <gtest/gtest.h>

#include <limits>
#include <memory>

#include "server/tracer/simd/denormals.h"

namespace itn::testing {
namespace {

using namespace tracer;

// Some columns of every list whose length depends on the request.
std::unique_ptr<Paths> some_paths() {
  auto paths = std::make_unique<Paths>();
  paths->scattered_at.resize(3);
  paths->edge_weight.resize(2);
  return paths;
}
constexpr int kColumns = 14 + 5;

// Another number in every column of a slot.
void fill(Paths& paths, size_t slot) {
  int number = 100;
  for_each_column(paths.columns(), [&](auto& column) {
    column[slot] = static_cast<typename std::decay_t<decltype(column)>::value_type>(number++);
  });
  EXPECT_EQ(number - 100, kColumns);
}

TEST(DenormalsTest, AreZeroForAWhile) {
  volatile float least = std::numeric_limits<float>::min(), denormal = least / 2;
  EXPECT_GT(denormal * 2, 0);
  {
    const DenormalsAsZero as_zero;
    EXPECT_EQ(least / 2, 0);     // that comes out
    EXPECT_EQ(denormal * 4, 0);  // that goes in
    EXPECT_GT(least * 2, 0);
  }
  EXPECT_EQ(least / 2, denormal);
  EXPECT_GT(denormal * 4, 0);
}

TEST(PathsTest, APathMovesWithAllItsColumns) {
  const auto paths = some_paths();
  fill(*paths, 7);
  paths->rays.position.set(7, {1, 2, 3});
  paths->rays.direction.set(7, {0, -1, 0});
  paths->rays.interaction[7] = Rays::kInside;
  paths->move(7, 4);
  int number = 100;
  for_each_column(paths->columns(), [&](auto& column) {
    EXPECT_EQ(static_cast<int>(column[4]), number) << "column " << number - 100;
    EXPECT_EQ(static_cast<int>(column[5]), 0) << "column " << number - 100;
    ++number;
  });
  EXPECT_EQ(paths->rays.position.at(4), (Vec3f{1, 2, 3}));
  EXPECT_EQ(paths->rays.direction.at(4), (Vec3f{0, -1, 0}));
  EXPECT_EQ(paths->rays.interaction[4], Rays::kInside);
}

TEST(PathsTest, APathBeginsWithNothingOfTheLast) {
  const auto paths = some_paths();
  fill(*paths, 3);
  paths->begin(3);
  double sum = 0;
  for_each_column(paths->columns(), [&](auto& column) { sum += static_cast<double>(column[3]); });
  // What is not 0: the weight; vertex 1, alive and alone.
  EXPECT_EQ(sum, 4);
  EXPECT_EQ(paths->weight[3], 1);
  EXPECT_EQ(paths->vertex[3], 1U);
  EXPECT_EQ(paths->alive[3], 1U);
  EXPECT_EQ(paths->delta_bounce[3], 1U);
}

TEST(PathsTest, AFactorMultipliesAllWeights) {
  const auto paths = some_paths();
  int weights = 0;
  for_each_column(paths->weights(), [&](FloatColumn& /*weight*/) { ++weights; });
  EXPECT_EQ(weights, 1 + 2);
}

}  // namespace
}  // namespace itn::testing
